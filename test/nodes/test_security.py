"""Security of the graph: asked for and not to be had, a node does not start unprotected."""

from __future__ import annotations

from xml.etree import ElementTree

from peers import TIMEOUT_S

from motion_detect_ros.benchmarks.node_interface import Endpoint, NodeInterface
from motion_detect_ros.benchmarks.security_policy import policy


def test_a_node_that_cannot_be_protected_does_not_start(start, monkeypatch, tmp_path, shown):
    """Without keys no middleware can; that of the wheels is built without security, with keys too."""
    (tmp_path / 'keystore' / 'enclaves' / 'motion_detect' / 'overlay').mkdir(parents=True)
    for name, value in {'ENABLE': 'true', 'STRATEGY': 'Enforce', 'KEYSTORE': str(tmp_path / 'keystore')}.items():
        monkeypatch.setenv(f'ROS_SECURITY_{name}', value)
    process = start('overlay', '--enclave', '/motion_detect/overlay', code=2)
    process.wait(TIMEOUT_S)
    last = (tmp_path / 'overlay.log').read_text().splitlines()[-1]
    assert last.startswith('error creating node: ')
    reason = 'Fast DDS is built without security' if 'doesn\'t have the security libraries' in last else 'no keys'
    shown('SROS 2 is asked for, and cannot be had', 'the node does not start, says why, exit code 2', reason)


def test_policy_of_one_node():
    """Worked by hand."""
    ends = (Endpoint('image_raw', 'sensor_msgs/Image', False, 'reliable', 5),
            Endpoint('detections', 'sensor_msgs/PointCloud2', True, 'reliable', 5))
    interface = NodeInterface(ends, {'~/reset': 'std_srvs/Trigger'}, {})
    profile = ElementTree.fromstring(policy({'planner': interface})).find('.//profile')
    assert profile.attrib == {'ns': '/', 'node': 'planner'}
    assert [(group.tag, group.attrib, [one.text for one in group]) for group in profile] == [
        ('topics', {'subscribe': 'ALLOW'}, ['/clock', 'image_raw']),
        ('topics', {'publish': 'ALLOW'}, ['detections']),
        ('services', {'reply': 'ALLOW'}, ['~/reset'])]
