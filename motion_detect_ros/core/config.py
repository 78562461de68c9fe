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

    max_corners: int = setting(700, 'corners tracked per frame', low=8, high=5000)
    corner_quality: float = setting(
        0.002, 'smallest accepted corner response, relative to the best', low=1e-6, high=1.0)
    lk_window_px: int = setting(15, 'window of the Lucas-Kanade tracker', low=5, high=51, unit='px')
    pyramid_levels: int = setting(3, 'pyramid levels of the tracker above the image itself', low=0, high=6)
    forward_backward_px: float = setting(
        0.5, 'largest accepted forward-backward error of a track', low=0.01, high=10.0, unit='px')
    ransac_threshold_px: float = setting(
        1.0, 'distance to the model up to which RANSAC counts a track as background', low=0.1, high=20.0, unit='px')
    smoothing: str = setting(
        'kalman', 'filter on the affine parameters', choices=('kalman', 'none'))
    process_noise_px_per_s2: float = setting(
        3000.0, 'how hard the camera may accelerate (standard deviation)', low=1.0, high=1e6, unit='px/s^2')
    max_gap_s: float = setting(
        1.0, 'a longer gap between frames starts everything anew', low=0.01, high=60.0, unit='s')


@dataclass(frozen=True)
class OpticalFlowConfig:
    """Dense flow."""

    baseline_s: float = setting(
        0.04, 'time over which flow is measured (the nearest whole number of frames, at least one)',
        low=0.001, high=2.0, unit='s')
    finest_scale: int = setting(
        2, 'finest pyramid level of DIS, 0 = full resolution', low=0, high=4)
    refinement_iterations: int = setting(
        2, 'rounds of variational refinement of DIS on every level', low=0, high=50)
    grid_px: int = setting(4, 'cell size of the published flow grid, working-resolution pixels',
                           low=1, high=32, unit='px')
    forward_backward_px: float = setting(
        0.7, 'largest accepted forward-backward error', low=0.05, high=20.0, unit='px')


@dataclass(frozen=True)
class BackgroundConfig:
    """What counts as background beyond the ego-motion, and how noisy the flow is."""

    noise_floor_px: float = setting(
        0.3, 'noise of the flow over the baseline is never taken to be smaller', low=0.01, high=10.0, unit='px')
    noise_share: float = setting(
        0.04, 'share of the camera-caused flow that is added to the noise', low=0.0, high=1.0)


@dataclass(frozen=True)
class Art2Config:
    """Clustering of the residual flow."""

    vigilance: float = setting(0.2, '0 accepts everything as one cluster, 1 only equal vectors', low=0.0, high=1.0)
    learning_rate: float = setting(
        0.95, 'share of the way a neuron moves to what it won (near 1 = fast learning)', low=0.01, high=1.0)
    initial_neurons: int = setting(15, 'neurons spread over the motions at once', low=1, high=200)
    max_neurons: int = setting(25, 'neurons the memory may grow to', low=2, high=200)
    forget_frames: int = setting(
        10, 'a neuron that wins nothing for this long is forgotten', low=1, high=1000, unit='frames')


@dataclass(frozen=True)
class ObjectsConfig:
    """From clusters to boxes."""

    min_side_px: float = setting(6.0, 'smaller boxes are dropped', low=1.0, high=1000.0, unit='px')
    max_area_share: float = setting(0.5, 'larger boxes are dropped, share of the image', low=0.001, high=1.0)
    join_match: float = setting(
        0.5, 'neighbouring clusters whose match is at least this are one object', low=0.0, high=1.0)
    evidence_sigma: float = setting(
        3.0, "how much better an object's own motion must explain a pixel, units of the image noise",
        low=0.1, high=100.0)
    peak_share: float = setting(
        0.15, 'pixels whose gain is under this share of the strongest ones are shadow or blur', low=0.0, high=1.0)
    min_fill: float = setting(
        0.1, 'smallest share of a box that must be explained by its own motion', low=0.0, high=1.0)
    closing_px: int = setting(
        9, 'gaps up to this size within an object are closed', low=1, high=99, unit='px')
    join_gap_share: float = setting(
        0.25, "patches of one motion are joined across a gap up to this share of the smaller one's size",
        low=0.0, high=5.0)


@dataclass(frozen=True)
class TracksConfig:
    """Identity over time."""

    confirm_hits: int = setting(3, 'detections before a track is reported', low=1, high=100)
    confirm_frames: int = setting(6, 'frames within which they must come', low=1, high=100)
    confirm_log_odds: float = setting(
        1.0, 'evidence summed over frames that a track needs before it is reported', low=-100.0, high=100.0)
    show_log_odds: float = setting(
        0.0, 'a confirmed track is reported while its evidence is at least this', low=-100.0, high=100.0)
    coast_frames: int = setting(3, 'frames a confirmed track lives without detection', low=0, high=100)


@dataclass(frozen=True)
class PipelineConfig:
    """All stages. ``PipelineConfig()`` is the default preset."""

    preprocessing: PreprocessingConfig = PreprocessingConfig()
    ego_motion: EgoMotionConfig = EgoMotionConfig()
    optical_flow: OpticalFlowConfig = OpticalFlowConfig()
    background: BackgroundConfig = BackgroundConfig()
    art2: Art2Config = Art2Config()
    objects: ObjectsConfig = ObjectsConfig()
    tracks: TracksConfig = TracksConfig()


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
    checked: Scalar = value
    return checked
