"""The shipped Fast DDS profile says what large images need."""

from __future__ import annotations

from xml.etree import ElementTree

from motion_detect_ros.presets import find_config


def test_profile_holds_a_whole_image_in_shared_memory():
    """Fast DDS 2.14: XML in its name space, SHM of 32 MB or more and UDP, built-in transports off."""
    name_space = '{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}'
    root = ElementTree.parse(find_config('fastdds_profile.xml')).getroot()
    assert root.tag == f'{name_space}profiles'
    transports = {t.findtext(f'{name_space}transport_id'): t for t in root.iter(f'{name_space}transport_descriptor')}
    kinds = {t.findtext(f'{name_space}type') for t in transports.values()}
    assert kinds == {'SHM', 'UDPv4'}
    shared, = (t for t in transports.values() if t.findtext(f'{name_space}type') == 'SHM')
    assert int(shared.findtext(f'{name_space}segment_size')) >= 32 * 2**20
    assert int(shared.findtext(f'{name_space}maxMessageSize')) >= 1920 * 1080 * 3
    participant = root.find(f'{name_space}participant')
    assert participant.get('is_default_profile') == 'true'
    used = {e.text for e in participant.iter(f'{name_space}transport_id')}
    assert used == set(transports)
    assert participant.findtext(f'.//{name_space}useBuiltinTransports') == 'false'
