"""Several cameras, each with its detector in a namespace of its own."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from motion_detect_ros.launching import pairs

OWN = (
    ('cameras', None, 'namespaces and sources: "front=0 rear=rtsp://10.0.0.2/live"'),
)


def describe(context):
    """The detector's launch file, once for each camera; its other arguments hold for all."""
    file = str(Path(__file__).with_name('motion_detect.launch.py'))
    return [IncludeLaunchDescription(
        PythonLaunchDescriptionSource(file),
        launch_arguments={'namespace': name, 'source': source, 'frame_id': f'{name}_optical_frame'}.items())
        for name, source in pairs('cameras', LaunchConfiguration('cameras').perform(context))]


def generate_launch_description():
    """One argument; those of motion_detect.launch.py are taken too."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=meaning)
          for name, default, meaning in OWN),
        OpaqueFunction(function=describe),
    ])
