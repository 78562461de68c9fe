"""What the processes of a graph need from their environment to pass large images fast (docs/performance.md)."""

from __future__ import annotations

import os

from motion_detect_ros.allocator import VARIABLES, tune_malloc
from motion_detect_ros.presets import find_config

PROFILE_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
PROFILE_NAME = 'fastdds_profile.xml'
#: Images this large are lost between processes by stock Fast DDS, bytes.
BIG_IMAGE_BYTES = 500_000


def additional_environment() -> dict[str, str]:
    """Transport profile and allocator settings, as far as the user has not set them."""
    ours = {PROFILE_VARIABLE: str(find_config(PROFILE_NAME)),
            **{name: str(value) for name, value in VARIABLES.items()}}
    return {name: value for name, value in ours.items() if name not in os.environ}


def environment() -> dict[str, str]:
    """The process environment with transport profile and allocator settings; the user's own values win."""
    return {**additional_environment(), **os.environ}


def use_here() -> None:
    """The same for this process, for participants that are yet to be made."""
    os.environ.update(environment())
    tune_malloc()


def profile_set() -> bool:
    """Whether some Fast DDS profile is in force."""
    return bool(os.environ.get(PROFILE_VARIABLE))


def big_image_trouble(image_bytes: int) -> str:
    """In a few words why images of so many bytes may be lost, and what helps; empty where they are not."""
    if image_bytes <= BIG_IMAGE_BYTES or profile_set():
        return ''
    return (f'images of {image_bytes} bytes without a Fast DDS profile: some may be lost; '
            f'set {PROFILE_VARIABLE} (README, Transport)')
