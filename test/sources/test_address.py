"""What is an address."""

from __future__ import annotations

import pytest

from motion_detect_ros.sources.address import is_address, path_of


@pytest.mark.parametrize(('source', 'address'), [
    ('0', True), ('rtsp://drone/live', True), ('flight.mp4', False), ('file:///data/flight.mp4', False),
    ('/data/7', False)])
def test_numbers_and_urls_are_addresses(source: str, address: bool):
    assert is_address(source) is address


@pytest.mark.parametrize(('source', 'path'), [
    ('file:///data/day 1/flight.mp4', '/data/day 1/flight.mp4'), ('file://flight.mp4', 'flight.mp4'), ('a/b', 'a/b')])
def test_a_file_address_is_a_path(source: str, path: str):
    assert str(path_of(source)) == path
