"""What is an address."""

from __future__ import annotations

from pathlib import Path

import pytest

from motion_detect_ros.sources.address import camera_number, is_address, path_of


@pytest.mark.parametrize(('source', 'address'), [
    ('0', True), ('rtsp://drone/live', True), ('flight.mp4', False), ('file:///data/flight.mp4', False),
    ('/data/7', False), ('/dev/video2', True), ('/dev/null', False), ('/dev/video2/clip.mp4', False)])
def test_numbers_and_urls_are_addresses(source: str, address: bool):
    assert is_address(source) is address


@pytest.mark.parametrize(('source', 'number'), [
    ('0', 0), ('12', 12), ('/dev/video2', 2), ('file:///dev/video12', 12), ('/dev/video', None), ('/dev/null', None),
    ('video2', None), ('rtsp://drone/dev/video2', None)])
def test_a_device_of_a_camera_is_its_number(source: str, number: int | None):
    assert camera_number(source) == number


def test_a_link_to_a_device_is_followed_each_time(tmp_path: Path):
    """As those in /dev/v4l/by-id, which keep their names where the numbers change."""
    link = tmp_path / 'usb-Maker_Model_1234-video-index0'
    link.symlink_to('/dev/video4')
    assert camera_number(str(link)) == 4
    link.unlink()
    link.symlink_to('/dev/video6')
    assert camera_number(str(link)) == 6


@pytest.mark.parametrize(('source', 'path'), [
    ('file:///data/day 1/flight.mp4', '/data/day 1/flight.mp4'), ('file://flight.mp4', 'flight.mp4'), ('a/b', 'a/b')])
def test_a_file_address_is_a_path(source: str, path: str):
    assert str(path_of(source)) == path
