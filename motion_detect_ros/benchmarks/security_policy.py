"""``config/motion_detect.policy.xml``: what every node may do on a ROS graph, in the policy format of SROS 2.

    python -m motion_detect_ros.benchmarks.node_reference --policy config/motion_detect.policy.xml

One enclave a node, made from what the running nodes offer, and from what settings make them offer besides.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree

from motion_detect_ros.benchmarks.node_interface import NodeInterface
from motion_detect_ros.bridge.topics import COMPRESSED

VERSION = '0.2.0'
ENCLAVE = '/motion_detect'
_STAGES = ('ego_motion', 'optical_flow', 'art2_clustering', 'pipeline')
#: What settings and optional packages add: image_transport, vision_msgs, use_sim_time.
OPTIONAL_SUBSCRIPTIONS: Mapping[str, tuple[str, ...]] = {COMPRESSED.name: (*_STAGES, 'overlay')}
OPTIONAL_PUBLISHERS: Mapping[str, tuple[str, ...]] = {'detections_2d': ('art2_clustering', 'pipeline')}
CLOCK = '/clock'

_HEAD = '''<?xml version="1.0" encoding="UTF-8"?>
<!-- SROS 2: ros2 security generate_artifacts -k KEYSTORE -p THIS_FILE. The nodes run under their own names and without
     a namespace, each in its enclave (the ROS argument enclave), /motion_detect/pipeline for the node pipeline.
     Written by motion_detect_ros.benchmarks.node_reference from the running nodes. -->
'''


def policy(found: Mapping[str, NodeInterface]) -> str:
    """The file. found: interface of each node by its name."""
    root = ElementTree.Element('policy', version=VERSION)
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for node, interface in found.items():
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'{ENCLAVE}/{node}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        profile = ElementTree.SubElement(profiles, 'profile', ns='/', node=node)
        _allow(profile, 'topic', 'subscribe', {CLOCK, *_ends(node, interface, False, OPTIONAL_SUBSCRIPTIONS)})
        _allow(profile, 'topic', 'publish', _ends(node, interface, True, OPTIONAL_PUBLISHERS))
        _allow(profile, 'service', 'reply', interface.services)
    ElementTree.indent(root)
    return f'{_HEAD}{ElementTree.tostring(root, encoding="unicode")}\n'


def _ends(
    node: str, interface: NodeInterface, publishes: bool, optional: Mapping[str, tuple[str, ...]],
) -> set[str]:
    return {end.topic for end in interface.endpoints if end.publishes == publishes} | {
        topic for topic, nodes in optional.items() if node in nodes}


def _allow(profile: ElementTree.Element, kind: str, act: str, names: Iterable[str]) -> None:
    group = ElementTree.SubElement(profile, f'{kind}s', {act: 'ALLOW'})
    for name in sorted(names):
        ElementTree.SubElement(group, kind).text = name
