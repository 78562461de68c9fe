"""Camera and detector: four nodes, or everything after the camera in one process."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from motion_detect_ros.launched_detector import ARGUMENTS, Detector
from motion_detect_ros.launching import declared, end_with, given


def describe(context):
    """Nodes for the arguments that were given."""
    return Detector(given(context, ARGUMENTS)).nodes(end_with())


def generate_launch_description():
    """Arguments, nodes."""
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=describe)])
