"""A bag through the detector, as if it were happening now."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from motion_detect_ros.launched_detector import ARGUMENTS as DETECTOR
from motion_detect_ros.launched_detector import Detector
from motion_detect_ros.launching import declared, end_with, existing, flag, given, number, told, word

#: There is no camera, and the time is that of /clock.
FIXED = {'use_sim_time': 'true', 'camera': 'false', 'source': '', 'frame_id': ''}
OWN = (
    ('bag', None, 'MCAP or db3 file, or a folder that holds one'),
    ('rate', '', 'speed against the recording; empty = as in params_file, else 1.0'),
    ('loop', '', 'start again at the end; empty = as in params_file, else false'),
    ('topics', '', 'topics to play, separated by commas; '
                   'empty = as in params_file, else all but results of this package'),
    ('clock', '', 'publish /clock with the times of recording; false where another player does; '
                  'empty = as in params_file, else true'),
)
ARGUMENTS = (*OWN, *(argument for argument in DETECTOR if argument[0] not in FIXED))
PLAYER = {'autostart': flag, 'rate': number, 'loop': flag, 'topics': word, 'clock': flag}


def describe(context):
    """The detector without camera, and the player, which ends it all when the bag is over."""
    values = {**given(context, ARGUMENTS), **FIXED}
    detector = Detector(values)
    player = {**detector.parameters(PLAYER), **detector.waiting(), 'use_sim_time': False,
              'bag': word('bag', existing('bag', values['bag']))}
    if detector.in_file('bag_player', 'play_results') is None:
        player['play_results'] = False
    return [*told(context, FIXED), *detector.nodes(end_with()),
            detector.node('bag_player', player, [], on_exit=end_with())]


def generate_launch_description():
    """Arguments, nodes."""
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=describe)])
