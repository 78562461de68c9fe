"""Every setting of the perception core, as frozen dataclasses.

A field carries its description, unit and range in its metadata; ROS parameters, YAML presets and the
documentation are made by walking these classes, so there is one place to change a setting.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from motion_detect_ros.core.errors import ConfigError

Scalar = bool | int | float | str


def setting(
    default: Scalar, doc: str, *, low: float | None = None, high: float | None = None,
    unit: str = '', choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field with description, unit and allowed values in its metadata."""
    return field(default=default, metadata={
        'doc': doc, 'low': low, 'high': high, 'unit': unit, 'choices': choices})


@dataclass(frozen=True)
class PreprocessingConfig:
    """Grey conversion, denoising and working resolution."""

    max_width_px: int = setting(
        960, 'wider images are shrunk to this width before processing', low=64, high=8192, unit='px')
    median_kernel_px: int = setting(0, 'median filter size, 0 = off', low=0, high=7, unit='px')
    ignore_top_px: int = setting(
        0, 'rows at the top of the image never looked at (burnt-in text)', low=0, high=2000, unit='px')


@dataclass(frozen=True)
class EgoMotionConfig:
    """Background motion from tracked corners."""

    max_corners: int = setting(600, 'corners tracked per frame', low=8, high=5000)
    corner_quality: float = setting(
        0.01, 'smallest accepted corner response, relative to the best', low=1e-5, high=1.0)


@dataclass(frozen=True)
class PipelineConfig:
    """All stages. ``PipelineConfig()`` is the default preset."""

    preprocessing: PreprocessingConfig = PreprocessingConfig()
    ego_motion: EgoMotionConfig = EgoMotionConfig()


def settings(config: Any, prefix: str = '') -> Iterator[tuple[str, Scalar, Mapping[str, Any]]]:
    """Walk a config: yields (dotted name, value, metadata) of every leaf, in declaration order."""
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        if dataclasses.is_dataclass(value):
            yield from settings(value, f'{prefix}{item.name}.')
        else:
            yield f'{prefix}{item.name}', value, item.metadata


def with_settings(config: PipelineConfig, values: Mapping[str, Any]) -> PipelineConfig:
    """A copy of ``config`` with the dotted names in ``values`` replaced.

    Raises: ConfigError for an unknown name, a wrong type or a value outside its range.
    """
    known = {name: (value, metadata) for name, value, metadata in settings(config)}
    for name, value in values.items():
        if name not in known:
            raise ConfigError(f'unknown setting {name!r}; known: {", ".join(sorted(known))}')
        config = _replace(config, name.split('.'), _checked(name, value, *known[name]))
    return config


def _replace(node: Any, path: list[str], value: Scalar) -> Any:
    head, *rest = path
    new = _replace(getattr(node, head), rest, value) if rest else value
    return dataclasses.replace(node, **{head: new})


def _checked(name: str, value: Any, default: Scalar, metadata: Mapping[str, Any]) -> Scalar:
    """``value`` as the type of ``default``, inside the range of ``metadata``."""
    kind = type(default)
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        raise ConfigError(f'{name}: expected {kind.__name__}, got {type(value).__name__} {value!r}')
    if metadata['choices'] and value not in metadata['choices']:
        raise ConfigError(f'{name}: expected one of {", ".join(metadata["choices"])}, got {value!r}')
    low, high = metadata['low'], metadata['high']
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        raise ConfigError(f'{name}: expected {low} to {high}, got {value!r}')
    return value  # type: ignore[no-any-return]
