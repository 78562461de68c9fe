"""What is an address."""

from __future__ import annotations

import pytest

from motion_detect_ros.sources.address import is_address


@pytest.mark.parametrize(('source', 'address'), [
    ('0', True), ('rtsp://drone/live', True), ('flight.mp4', False), ('/data/7', False)])
def test_numbers_and_urls_are_addresses(source: str, address: bool):
    assert is_address(source) is address
