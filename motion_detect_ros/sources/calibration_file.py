"""Calibrations in the YAML that ROS's camera_calibration writes and camera drivers read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.raw import one_line

#: Key of the file -> number of values.
_MATRICES = {'camera_matrix': 9, 'rectification_matrix': 9, 'projection_matrix': 12}

#: CameraInfo holds 32 bits.
_TOO_WIDE_PX = 1 << 32


@dataclass(frozen=True)
class CalibrationFile:
    """The fields of sensor_msgs/CameraInfo; ``width``, ``height`` of the images in pixels."""

    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    r: tuple[float, ...]
    p: tuple[float, ...]


def read_calibration(path: Path) -> CalibrationFile:
    """Raises: SourceError, one line, for a file that is missing, unreadable or lacks something."""
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise SourceError(f'{path}: expected a calibration, got {error.strerror}') from None
    except (ValueError, RecursionError, yaml.YAMLError) as error:  # ValueError: no UTF-8, no such date
        raise SourceError(f'{path}: expected a calibration, got {one_line(error)}') from None
    if not isinstance(content, Mapping):
        raise SourceError(f'{path}: expected a calibration (image_width, camera_matrix, ...)')
    try:
        k, r, p = (_values(path, content, name, count) for name, count in _MATRICES.items())
        lens = _values(path, content, 'distortion_coefficients')
        return CalibrationFile(_pixels(path, content, 'image_width'), _pixels(path, content, 'image_height'),
                               str(content.get('distortion_model', 'plumb_bob')), lens, k, r, p)
    except KeyError as error:
        raise SourceError(f'{path}: expected a calibration with {error.args[0]}, which is missing') from None
    except (TypeError, ValueError, OverflowError) as error:
        raise SourceError(f'{path}: expected a calibration, {type(error).__name__}: {error}') from None


def _pixels(path: Path, content: Mapping[str, Any], name: str) -> int:
    value = content[name]
    if not isinstance(value, int) or not 0 <= value < _TOO_WIDE_PX:
        raise SourceError(f'{path}: {name}: expected a whole number of pixels, got {value!r}')
    return value


def _values(path: Path, content: Mapping[str, Any], name: str, count: int | None = None) -> tuple[float, ...]:
    data = tuple(float(value) for value in content[name]['data'])
    if count is not None and len(data) != count:
        raise SourceError(f'{path}: {name}: expected {count} values, got {len(data)}')
    return data
