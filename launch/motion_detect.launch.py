"""Camera and detector: four nodes, or everything after the camera in one process."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from motion_detect_ros.bridge.transport import additional_environment
from motion_detect_ros.launching import STAGES, end_with, existing, flag, parameter_file, text
from motion_detect_ros.sources.address import is_address

ARGUMENTS = (
    ('namespace', '', 'namespace of all nodes'),
    ('use_sim_time', 'false', 'take time from /clock'),
    ('params_file', 'default', 'preset (default, visdrone, kitti, report) or path of a parameter file'),
    ('autostart', 'true', 'configure and activate the nodes at start'),
    ('log_level', 'info', 'debug, info, warn, error'),
    ('use_respawn', 'false', 'start a node again that has ended'),
    ('mode', 'nodes', 'nodes: one process a stage; pipeline: all stages in one process'),
    ('camera', 'true', 'start the camera node; false: another driver publishes the images'),
    ('source', '0', 'what the camera node reads: number, file, folder or address; the launch ends with a file'),
    ('frame_id', 'camera_optical_frame', 'frame_id that the camera node gives its images'),
    ('image_topic', 'image_raw', 'topic of the images'),
    ('camera_info_topic', 'camera_info', 'topic of the calibration'),
    ('image_reliability', 'auto', 'asked of the camera driver; auto: reliable, best effort where it is'),
    ('image_transport', 'raw', 'raw, or compressed: the compressed images of image_topic'),
    ('rectified', 'false', 'the images are rectified: matrix P of camera_info holds, not K'),
    ('overlay', 'true', 'start the overlay node'),
    ('cpus', '', 'cores that the nodes may run on, as taskset takes them (0,1 or 0-3); empty = all'),
)
CHOICES = {'mode': list(STAGES), 'image_reliability': ['auto', 'reliable', 'best_effort'],
           'image_transport': ['raw', 'compressed']}


def describe(context):
    """Nodes for the arguments that were given."""
    value = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    file = parameter_file(value['params_file'])
    common = {'autostart': flag('autostart', value['autostart']),
              'use_sim_time': flag('use_sim_time', value['use_sim_time'])}
    images = {**common, 'image_reliability': value['image_reliability'],
              'image_transport': value['image_transport'], 'rectified': flag('rectified', value['rectified'])}
    stages = STAGES[value['mode']]
    respawn = flag('use_respawn', value['use_respawn'])

    topics = [('image_raw', value['image_topic']), ('image_raw/compressed', f'{value["image_topic"]}/compressed'),
              ('camera_info', value['camera_info_topic'])]

    def node(name, parameters, **options):
        return Node(
            package='motion_detect_ros', executable=name, name=name, namespace=value['namespace'], output='screen',
            parameters=[file, parameters], remappings=topics,
            arguments=['--ros-args', '--log-level', value['log_level']],
            prefix=f'taskset --cpu-list {value["cpus"]}' if value['cpus'] else None,
            additional_env=additional_environment(),
            **{'respawn': respawn, 'respawn_delay': 2.0, **options})

    nodes = [node(name, images) for name in stages]
    if flag('camera', value['camera']):
        camera = {**common, 'source': text(value['source']), 'frame_id': text(value['frame_id'])}
        if is_address(value['source']):
            nodes.append(node('camera', camera))
        else:  # a file is over once, and its start would be lost while the stages warm up
            existing('source', value['source'])
            nodes.append(node('camera', {**camera, 'wait_for_nodes': text(','.join(stages))},
                              respawn=False, on_exit=end_with))
    if flag('overlay', value['overlay']):
        nodes.append(node('overlay', images))
    return nodes


def generate_launch_description():
    """Arguments, nodes."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=meaning, choices=CHOICES.get(name))
          for name, default, meaning in ARGUMENTS),
        OpaqueFunction(function=describe),
    ])
