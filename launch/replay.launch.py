"""A bag through the detector, as if it were happening now."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from motion_detect_ros.bridge.transport import additional_environment
from motion_detect_ros.launching import STAGES, end_with, existing, flag, number, text

OWN = (
    ('bag', None, 'MCAP or db3 file, or a folder that holds one'),
    ('rate', '1.0', 'speed against the recording'),
    ('loop', 'false', 'start again at the end'),
    ('topics', '', 'topics to play, separated by commas; empty = all'),
    ('clock', 'true', 'publish /clock with the times of recording; false where another player does'),
)


def describe(context):
    """The player, which ends it all when the bag is over."""
    names = ('mode', 'namespace', *(name for name, _, _ in OWN))
    value = {name: LaunchConfiguration(name).perform(context) for name in names}
    # The stages take different times to warm up; a player that does not wait for all of them loses the first images.
    parameters = {
        'bag': text(existing('bag', value['bag'])), 'rate': number('rate', value['rate']),
        'loop': flag('loop', value['loop']), 'topics': text(value['topics']), 'clock': flag('clock', value['clock']),
        'wait_for_nodes': text(','.join(STAGES[value['mode']]))}
    return [Node(
        package='motion_detect_ros', executable='bag_player', name='bag_player', output='screen',
        namespace=value['namespace'], parameters=[parameters], additional_env=additional_environment(),
        on_exit=end_with)]


def generate_launch_description():
    """The detector without camera, and the player."""
    detector = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(Path(__file__).with_name('motion_detect.launch.py'))),
        launch_arguments={'camera': 'false', 'use_sim_time': 'true'}.items())
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=meaning)
          for name, default, meaning in OWN),
        detector,
        OpaqueFunction(function=describe),
    ])
