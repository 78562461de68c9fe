"""Which settings a running pipeline takes at once, which make it start anew, and which it cannot take."""

from __future__ import annotations

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import settings

#: Groups and settings that apply from the next frame on and keep all history.
_AT_ONCE = (
    'ego_motion.max_corners', 'ego_motion.corner_quality', 'ego_motion.lk_window_px', 'ego_motion.pyramid_levels',
    'ego_motion.forward_backward_px', 'ego_motion.ransac_threshold_px', 'ego_motion.max_gap_s',
    'optical_flow.finest_scale', 'optical_flow.refinement_iterations', 'optical_flow.smoothness',
    'optical_flow.forward_backward_px',
    'background.depth_noise_share', 'background.noise_floor_px', 'background.noise_share',
    'art2.vigilance', 'art2.learning_rate', 'art2.initial_neurons', 'art2.spread_match', 'art2.max_neurons',
    'art2.forget_s', 'art2.merge_match', 'art2.background_sigma', 'art2.learning',
    'objects.', 'tracks.confirm_s', 'tracks.confirm_window_s', 'tracks.confirm_log_odds', 'tracks.show_log_odds',
    'tracks.coast_s', 'tracks.appearance_hold_s', 'load.decimation_keep', 'load.decimation_of', 'load.adapt',
)
#: Those that are read once, at the start of a process.
_FIXED = ('imu.use', 'imu.time_offset_s', 'load.threads')


def is_fixed(name: str) -> bool:
    """Whether a setting cannot change while a pipeline runs."""
    return name in _FIXED


def structural_changes(old: PipelineConfig, new: PipelineConfig) -> list[str]:
    """Names of the settings that differ and need a new start, without frames, neurons and tracks."""
    before = {name: value for name, value, _ in settings(old)}
    return [name for name, value, _ in settings(new) if value != before[name] and not name.startswith(_AT_ONCE)]
