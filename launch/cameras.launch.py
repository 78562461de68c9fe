"""Several cameras, each with its detector in a namespace of its own."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from motion_detect_ros.launched_detector import ARGUMENTS as DETECTOR
from motion_detect_ros.launched_detector import Detector
from motion_detect_ros.launching import declared, end_with, given, namespace, pairs, told

#: Each camera has its own of these.
REPLACED = {'source': '', 'frame_id': ''}
OWN = (
    ('cameras', None, 'namespaces and sources: "front=0 rear=rtsp://10.0.0.2/live"; '
                      'the launch ends with the last file; frame_id is front_optical_frame and so on'),
)
ARGUMENTS = (*OWN, *(argument for argument in DETECTOR if argument[0] not in REPLACED))


def describe(context):
    """The nodes of motion_detect.launch.py for each camera, once all cameras are known to be right."""
    values = given(context, ARGUMENTS)
    cameras = pairs('cameras', values['cameras'])
    outer = namespace('namespace', values['namespace'])
    inner = [namespace('cameras', name).strip('/') for name, _ in cameras]
    detectors = [Detector({
        **values, 'namespace': f'{outer}/{name}' if outer else name, 'source': source,
        'frame_id': f'{name}_optical_frame'}) for name, (_, source) in zip(inner, cameras)]
    ends = end_with(len(detectors))  # a live camera among them does not end, nor does the launch
    return [*told(context, REPLACED), *(node for detector in detectors for node in detector.nodes(ends))]


def generate_launch_description():
    """Arguments, nodes."""
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=describe)])
