"""A bag through the detector, as if it were happening now."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

OWN = (
    ('bag', '', 'MCAP or db3 file'),
    ('rate', '1.0', 'speed against the recording'),
    ('loop', 'false', 'start again at the end'),
    ('topics', '', 'topics to play, separated by commas; empty = all'),
    ('clock', 'true', 'publish /clock with the times of recording; false where another player does'),
)


def generate_launch_description():
    """The detector without camera, and a player that ends it all when the bag is over."""
    detector = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(Path(__file__).with_name('motion_detect.launch.py'))),
        launch_arguments={'camera': 'false', 'use_sim_time': 'true'}.items())
    # The stages take different times to warm up; a player that does not wait for all of them loses the first images.
    stages = PythonExpression(["3 if '", LaunchConfiguration('mode'), "' == 'nodes' else 1"])
    given = {'bag': str, 'rate': float, 'loop': bool, 'topics': str, 'clock': bool}
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, kind in given.items()}
    parameters['wait_for_subscribers'] = ParameterValue(stages, value_type=int)
    player = Node(
        package='motion_detect_ros', executable='bag_player', name='bag_player', output='screen',
        namespace=LaunchConfiguration('namespace'), parameters=[parameters],
        on_exit=Shutdown(reason='the bag is over'))
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text) for name, default, text in OWN),
        detector,
        player,
    ])
