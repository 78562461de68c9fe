"""The settings that are worth searching, and where.

Chosen by what docs/accuracy.md shows of each ("What each part is worth", "What was tried"): those whose change moved
the mean F1 by 0.01 and more and for which one value does not suit all clips. The ranges lie within those of the
settings and leave out what no clip gained from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import Scalar, settings, with_settings


@dataclass(frozen=True)
class Dimension:
    """One setting and its range. ``log``: what counts is by which factor it changes."""

    name: str
    low: float
    high: float
    log: bool = False


SEARCHED = (
    Dimension('background.noise_floor_px', 0.05, 1.0, log=True),     # 0.3 to 0.2: KITTI 0.65 to 0.75
    Dimension('background.noise_share', 0.01, 0.15, log=True),       # without it and the next: -0.12
    Dimension('background.depth_noise_share', 0.005, 0.1, log=True),
    Dimension('optical_flow.smoothness', 3.0, 40.0, log=True),       # 20 to 10: KITTI 0.69 to 0.78
    Dimension('optical_flow.forward_backward_px', 0.3, 3.0, log=True),  # without: -0.07
    Dimension('art2.vigilance', 0.1, 0.4),                           # 4 noise units are 0.2, 9 are 0.1, 1.5 are 0.4
    Dimension('objects.join_match', 0.2, 0.9),                       # without: -0.20
    Dimension('objects.photometric_sigma', 1.0, 8.0, log=True),      # without: -0.17
    Dimension('objects.peak_share', 0.0, 0.4),                       # without: -0.10 at IoU 0.5
    Dimension('tracks.confirm_log_odds', -4.0, 5.0),                 # without: -0.10; by family -1, 1, 3
    Dimension('tracks.coast_s', 0.0, 0.5),                           # without: -0.02
)
#: A setting that moves along with a searched one, at the distance that the start has.
FOLLOWS: Mapping[str, str] = {'tracks.show_log_odds': 'tracks.confirm_log_odds'}


def dimensions(names: Sequence[str] = ()) -> list[Dimension]:
    """Those of ``SEARCHED`` that are named, or all; a named float setting that is not among them has its own range.

    Raises: ConfigError for a name that is no setting, or none with a range of floats.
    """
    known = {dimension.name: dimension for dimension in SEARCHED}
    return [known.get(name) or _whole_range(name) for name in names] if names else list(SEARCHED)


def changed(start: PipelineConfig, values: Mapping[str, float]) -> PipelineConfig:
    """The start with these values, and with what follows them."""
    old = {name: (value, metadata) for name, value, metadata in settings(start)}
    changes: dict[str, Scalar] = dict(values)
    for follower, leader in FOLLOWS.items():
        if leader in values and follower not in values:
            value, metadata = old[follower]
            moved = float(value) + values[leader] - float(old[leader][0])
            changes[follower] = min(max(moved, metadata['low']), metadata['high'])
    return with_settings(start, changes)


def _whole_range(name: str) -> Dimension:
    found = {each: (value, metadata) for each, value, metadata in settings(PipelineConfig())}
    if name not in found:
        raise ConfigError(f'unknown setting {name!r}; searched by default: {", ".join(one.name for one in SEARCHED)}')
    value, metadata = found[name]
    if type(value) is not float or metadata['low'] is None:
        raise ConfigError(f'{name}: expected a setting with a range of floats, got {value!r}')
    return Dimension(name, metadata['low'], metadata['high'])
