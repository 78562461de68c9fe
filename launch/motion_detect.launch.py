"""Camera and detector: four nodes, or everything after the camera in one process."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.presets import find_config

ARGUMENTS = (
    ('namespace', '', 'namespace of all nodes'),
    ('use_sim_time', 'false', 'take time from /clock'),
    ('params_file', 'default', 'preset (default, visdrone, kitti, report) or full path of a parameter file'),
    ('autostart', 'true', 'configure and activate the nodes at start'),
    ('log_level', 'info', 'debug, info, warn, error'),
    ('use_respawn', 'false', 'start a node again that has ended'),
    ('mode', 'nodes', 'nodes: one process a stage; pipeline: all stages in one process'),
    ('camera', 'true', 'start the camera node; false: another driver publishes the images'),
    ('source', '0', 'what the camera node reads: number, file, folder or address'),
    ('image_topic', 'image_raw', 'topic of the images'),
    ('camera_info_topic', 'camera_info', 'topic of the calibration'),
    ('image_reliability', 'reliable', 'reliable or best_effort, as the camera driver publishes'),
    ('compressed', 'false', 'subscribe to the compressed images of image_topic'),
    ('rectified', 'false', 'the images are rectified: matrix P of camera_info holds, not K'),
    ('overlay', 'true', 'start the overlay node'),
    ('cpus', '', 'cores that the nodes may run on, as taskset takes them (0,1 or 0-3); empty = all'),
)
STAGES = ('ego_motion', 'optical_flow', 'art2_clustering')


def describe(context):
    """Nodes for the arguments that were given."""
    value = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    file = value['params_file']
    file = file if file.endswith(('.yaml', '.yml')) else str(find_config(f'{file}.yaml'))
    common = {'autostart': value['autostart'] == 'true', 'use_sim_time': value['use_sim_time'] == 'true'}
    images = {**common, 'image_reliability': value['image_reliability'], 'compressed': value['compressed'] == 'true'}
    stage = {**images, 'rectified': value['rectified'] == 'true'}

    topics = [('image_raw', value['image_topic']), ('image_raw/compressed', f'{value["image_topic"]}/compressed'),
              ('camera_info', value['camera_info_topic'])]

    def node(name, parameters):
        return Node(
            package='motion_detect_ros', executable=name, name=name, namespace=value['namespace'], output='screen',
            parameters=[file, parameters], remappings=topics,
            arguments=['--ros-args', '--log-level', value['log_level']],
            prefix=f'taskset --cpu-list {value["cpus"]}' if value['cpus'] else None,
            respawn=value['use_respawn'] == 'true', respawn_delay=2.0)

    nodes = [node(name, stage) for name in (STAGES if value['mode'] == 'nodes' else ('pipeline',))]
    if value['camera'] == 'true':
        nodes.append(node('camera', {**common, 'source': value['source']}))
    if value['overlay'] == 'true':
        nodes.append(node('overlay', images))
    return nodes


def generate_launch_description():
    """Arguments, transport environment, nodes."""
    ours = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'MALLOC_MMAP_THRESHOLD_', 'MALLOC_TRIM_THRESHOLD_', 'MALLOC_TOP_PAD_')
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text) for name, default, text in ARGUMENTS),
        *(SetEnvironmentVariable(name, environment()[name]) for name in ours),
        OpaqueFunction(function=describe),
    ])
