"""Every setting of the perception core, as frozen dataclasses.

ROS parameters, YAML presets and the documentation are made by walking these classes (``core.settings``), so there is
one place to change a setting.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.regions import parse_regions
from motion_detect_ros.core.self_tuning import SelfTuningConfig
from motion_detect_ros.core.settings import setting

#: Methods of dense flow (``core.flow_methods``).
FLOW_METHODS = ('dis', 'dis_ultrafast', 'dis_fast', 'dis_medium', 'farneback', 'lk', 'variational', 'dual_tvl1',
                'deepflow', 'simpleflow', 'rlof', 'pcaflow', 'onnx')
#: Features of the flow besides the motion itself (``core.clustering.feature_vectors``).
FLOW_FEATURES = ('magnitude', 'angle', 'divergence', 'curl', 'consistency', 'temporal_change', 'hoof', 'entropy',
                 'coherence')


@dataclass(frozen=True)
class PreprocessingConfig:
    """Grey conversion, denoising and working resolution."""

    max_width_px: int = setting(
        960, 'wider images are shrunk to this width before processing', low=64, high=8192, unit='px')
    min_width_px: int = setting(
        0, 'narrower images are enlarged to this width, twice at most; 0 = never', low=0, high=8192, unit='px')
    median_kernel_px: int = setting(
        0, 'median filter size, 0 and 1 = off, even ones are taken one larger', low=0, high=7, unit='px')
    mean_shift_px: int = setting(
        0, 'radius of mean-shift smoothing, 0 = off; tens of ms and more a frame', low=0, high=20, unit='px')
    mean_shift_gray: float = setting(
        12.0, 'grey levels that mean-shift smoothing mixes', low=1.0, high=128.0, unit='grey levels')
    ignore_top_px: int = setting(
        0, 'rows at the top of the image never looked at (burnt-in text)', low=0, high=2000, unit='px')
    ignore_regions: str = setting(
        '', 'regions of the full-resolution image never looked at, "x,y,w,h; x,y,w,h"', unit='px')
    find_overlay: bool = setting(
        False, 'corners that stay the same for seconds while the picture moves, and the edges connected to them, are '
        'masked as burnt-in overlay')

    def __post_init__(self) -> None:
        parse_regions(self.ignore_regions)


@dataclass(frozen=True)
class EgoMotionConfig:
    """How the camera moved the background."""

    method: str = setting(
        'indirect', 'what is compared: indirect = tracked features, direct = grey values, flow = coarse dense flow',
        choices=('indirect', 'direct', 'flow'))
    pyramid: str = setting(
        'gaussian', 'method direct compares grey values (gaussian) or details without the light that changes slowly '
        'from place to place (laplacian)', choices=('gaussian', 'laplacian'))
    model: str = setting(
        'affine', 'family of warps; quadratic is the flow of a plane',
        choices=('translation', 'similarity', 'affine', 'homography', 'quadratic'))
    features: str = setting(
        'shi_tomasi', 'what is tracked; brisk needs OpenCV 4 or opencv-contrib',
        choices=('shi_tomasi', 'harris', 'fast', 'orb', 'brisk', 'mser'))
    max_corners: int = setting(700, 'features tracked per frame', low=48, high=5000)
    corner_quality: float = setting(
        0.002, 'smallest accepted strength of a feature, relative to the best', low=1e-6, high=1.0)
    lk_window_px: int = setting(16, 'window of the Lucas-Kanade tracker', low=5, high=51, unit='px')
    pyramid_levels: int = setting(3, 'pyramid levels of the tracker above the image itself', low=0, high=6)
    forward_backward_px: float = setting(
        0.5, 'largest accepted forward-backward error of a track', low=0.01, high=10.0, unit='px')
    ransac_threshold_px: float = setting(
        1.0, 'distance to the model up to which RANSAC counts a track as background', low=0.1, high=20.0, unit='px')
    smoothing: str = setting(
        'kalman', 'filter on the affine parameters; autoregressive learns the rhythm of a shaking camera',
        choices=('kalman', 'autoregressive', 'none'))
    process_noise_px_per_s2: float = setting(
        3000.0, 'how hard the camera may accelerate (standard deviation)', low=1.0, high=1e6, unit='px/s^2')
    ar_order: int = setting(
        4, 'autoregressive: measurements that the next one is predicted from', low=1, high=12, unit='frames')
    ar_forgetting_s: float = setting(
        1.6, 'autoregressive: over how long its weights are learnt', low=0.05, high=60.0, unit='s')
    max_gap_s: float = setting(1.0, 'a longer gap between frames starts everything anew', low=0.01, high=60.0, unit='s')
    relative_pose: bool = setting(
        False, 'rotation, direction of travel, epipole and ground plane from the tracks; needs calibration or takes '
        'background.focal_share; methods indirect and flow')

    def __post_init__(self) -> None:
        if self.relative_pose and self.method == 'direct':
            raise ConfigError('ego_motion.relative_pose: expected ego_motion.method indirect or flow, got direct')


@dataclass(frozen=True)
class ImuConfig:
    """A gyroscope beside the camera."""

    use: bool = setting(
        False, 'rotation of the IMU as prior of the ego-motion, and instead of it where the image determines none; '
        'needs a calibrated camera')
    time_offset_s: float = setting(0.0, "added to the IMU's stamps to get the camera's", low=-10.0, high=10.0, unit='s')
    roll_rad: float = setting(
        0.0, "optical frame from IMU frame, Rz(yaw) Ry(pitch) Rx(roll): about the optical x axis; an IMU with x ahead, "
        'y left, z up needs 1.5708, -1.5708, 0', low=-3.2, high=3.2, unit='rad')
    pitch_rad: float = setting(0.0, 'the same about y', low=-3.2, high=3.2, unit='rad')
    yaw_rad: float = setting(0.0, 'the same about z', low=-3.2, high=3.2, unit='rad')
    noise_rad_s: float = setting(
        0.01, 'error of the rate averaged over a frame, bias included (standard deviation)',
        low=1e-6, high=1.0, unit='rad/s')
    max_gap_s: float = setting(0.15, 'longer gaps between samples are not bridged', low=0.001, high=10.0, unit='s')


@dataclass(frozen=True)
class OpticalFlowConfig:
    """Dense flow."""

    method: str = setting(
        'dis', 'dis is dis_fast with finest_scale, refinement_iterations and smoothness; from dual_tvl1 on they need '
        'opencv-contrib, onnx needs onnxruntime', choices=FLOW_METHODS)
    onnx_model: str = setting('', 'file of the network that method onnx runs')
    baseline_s: float = setting(
        0.04, 'time over which flow is measured (the nearest whole number of frames, at least one, at most 16)',
        low=0.001, high=2.0, unit='s')
    every_s: float = setting(
        0.0, 'interval of flow, 0 = every frame, else every second one at most, but for the first ones; '
        'in between its objects move on',
        low=0.0, high=1.0, unit='s')
    finest_scale: int = setting(
        2, 'finest pyramid level of methods dis and variational, 0 = full resolution', low=0, high=4)
    refinement_iterations: int = setting(
        2, 'rounds of variational refinement on every level, method dis', low=0, high=50)
    smoothness: float = setting(
        10.0, 'weight of smooth flow against equal grey values in these rounds: more holds noise down, less lets small '
        'objects move for themselves', low=0.1, high=1000.0)
    grid_px: int = setting(4, 'cell size of the flow grid, working-resolution pixels', low=1, high=32, unit='px')
    forward_backward_px: float = setting(0.7, 'largest accepted forward-backward error', low=0.05, high=20.0, unit='px')
    full_every: int = setting(
        1, 'flow of the whole image in every such frame, in between only around the last moving cells; only with '
        'every_s 0', low=1, high=100, unit='frames')

    def __post_init__(self) -> None:
        if self.method == 'onnx' and not self.onnx_model:
            raise ConfigError('optical_flow.onnx_model: expected the file of a network for optical_flow.method onnx, '
                              'got none')


@dataclass(frozen=True)
class BackgroundConfig:
    """What counts as background beyond the ego-motion, and how noisy the flow is."""

    model: str = setting(
        'auto', 'planar = one smooth surface; epipolar = static points at any depth; auto = whichever of the two fits',
        choices=('auto', 'planar', 'epipolar'))
    focal_share: float = setting(
        0.9, 'focal length where no calibration is known, share of the image width', low=0.2, high=10.0)
    depth_noise_share: float = setting(
        0.02, 'share of the total flow that is added to the noise, three-dimensional background', low=0.0, high=1.0)
    noise_floor_px: float = setting(
        0.2, 'noise of the flow over the baseline is never taken to be smaller', low=0.01, high=10.0, unit='px')
    noise_share: float = setting(
        0.06, 'share of the total flow that is added to the noise, planar background', low=0.0, high=1.0)


@dataclass(frozen=True)
class Art2Config:
    """Clustering of the residual flow."""

    variant: str = setting(
        'magnitude', 'magnitude compares whole vectors, classic (Carpenter and Grossberg) their directions only',
        choices=('magnitude', 'classic'))
    features: str = setting(
        'motion', 'what the compared vectors consist of, separated by commas: motion (both components), '
        + ', '.join(FLOW_FEATURES))
    vigilance: float = setting(
        0.2, '0 accepts everything as one cluster, 1 only equal vectors; classic needs 0.9 and more', low=0.0, high=1.0)
    learning_rate: float = setting(
        0.95, 'share of the way a neuron moves to what it won (near 1 = fast learning); alpha of classic',
        low=0.01, high=1.0)
    initial_neurons: int = setting(15, 'neurons spread over the motions at once', low=1, high=200)
    spread_match: float = setting(
        0.6, 'magnitude: they spread until all that clearly moves matches one so well; 0.6 tells speeds of 3 : 7 and'
        ' directions of 47 degrees apart, 0.8 speeds of 2 : 3 and 23 degrees', low=0.0, high=1.0)
    max_neurons: int = setting(25, 'neurons the network may grow to', low=2, high=200)
    forget_s: float = setting(
        0.4, 'a neuron that wins nothing for this long is forgotten', low=0.001, high=60.0, unit='s')
    merge_match: float = setting(1.0, 'neurons whose match is over this become one, 1 = none', low=0.0, high=1.0)
    background_sigma: float = setting(
        4.0, 'classic: vectors up to this length are background', low=0.0, high=1000.0, unit='noise units')
    learning: str = setting(
        'slow', 'classic: slow = one weight update for each vector, fast = updates until the weights settle',
        choices=('slow', 'fast'))
    a: float = setting(10.0, 'classic: feedback from u to w', low=0.0, high=1000.0)
    b: float = setting(10.0, 'classic: feedback from q to v', low=0.0, high=1000.0)
    c: float = setting(0.1, 'classic: weight of p in the test for reset; c d / (1 - d) is at most 1', low=0.0, high=1.0)
    d: float = setting(0.9, 'classic: output of the winning neuron', low=0.01, high=0.99)
    e: float = setting(0.0, 'classic: added to every norm', low=0.0, high=0.1)
    theta: float = setting(0.1, 'classic: components of the normalised vector up to this are noise', low=0.0, high=0.99)

    def __post_init__(self) -> None:
        unknown = [name for name in self.feature_names if name not in ('motion', *FLOW_FEATURES)]
        if unknown or not self.feature_names:
            raise ConfigError(f'art2.features: expected some of motion, {", ".join(FLOW_FEATURES)}, '
                              f'got {", ".join(unknown) or "none"}')
        if self.initial_neurons > self.max_neurons:
            raise ConfigError(f'art2.initial_neurons: expected at most art2.max_neurons ({self.max_neurons}), '
                              f'got {self.initial_neurons}')
        if self.c * self.d > 1.0 - self.d + 1e-9:
            ratio = self.c * self.d / (1.0 - self.d)
            raise ConfigError(f'art2.c, art2.d: expected c d / (1 - d) of at most 1, got {ratio:.3g}')

    @property
    def feature_names(self) -> tuple[str, ...]:
        """The names in ``features``."""
        return tuple(name.strip() for name in self.features.split(',') if name.strip())


@dataclass(frozen=True)
class ObjectsConfig:
    """From clusters to boxes."""

    min_side_px: float = setting(6.0, 'smaller boxes are dropped', low=1.0, high=1000.0, unit='working px')
    max_area_share: float = setting(0.8, 'larger boxes are dropped, share of the image', low=0.001, high=1.0)
    join_match: float = setting(
        0.5, 'neighbouring clusters whose match is at least this are one object', low=0.0, high=1.0)
    photometric_sigma: float = setting(
        4.0, "how much better an object's own motion must explain a pixel, units of the image noise",
        low=0.1, high=100.0)
    peak_share: float = setting(
        0.15, 'pixels whose gain is under this share of the strongest ones are shadow or blur', low=0.0, high=1.0)
    closing_px: int = setting(5, 'gaps in objects up to this, made odd, are closed', low=1, high=99, unit='working px')


@dataclass(frozen=True)
class TrajectoriesConfig:
    """Small and slow objects, from points tracked for a second."""

    use: bool = setting(False, 'candidates from points tracked over a second, besides those of flow')
    max_points: int = setting(6000, 'points tracked at once', low=200, high=50000)


@dataclass(frozen=True)
class TracksConfig:
    """Identity over time."""

    confirm_s: float = setting(
        0.12, 'an object is reported once detected for so long, in two frames at least', low=0.0, high=60.0, unit='s')
    confirm_window_s: float = setting(0.24, 'time within which that must be', low=0.0, high=60.0, unit='s')
    confirm_log_odds: float = setting(
        1.0, 'log odds summed over frames that a track needs before it is reported', low=-100.0, high=100.0)
    show_log_odds: float = setting(
        0.0, 'a confirmed track is reported while its summed log odds are at least this', low=-100.0, high=100.0)
    coast_s: float = setting(
        0.12, 'a confirmed track lives so long undetected, one frame at least unless 0', low=0.0, high=60.0, unit='s')
    appearance: str = setting(
        'none', 'objects that stop are recognised by their appearance: template (pixels) or camshift (grey values)',
        choices=('none', 'template', 'camshift'))
    appearance_hold_s: float = setting(
        2.0, 'how long they are reported where they are, their score falling', low=0.0, high=60.0, unit='s')

    def __post_init__(self) -> None:
        if self.confirm_s > self.confirm_window_s:
            raise ConfigError(f'tracks.confirm_s: expected at most tracks.confirm_window_s ({self.confirm_window_s}), '
                              f'got {self.confirm_s}')


@dataclass(frozen=True)
class LoadConfig:
    """How much of the stream is worked on."""

    decimation_keep: int = setting(1, 'the first so many ...', low=1, high=1000, unit='frames')
    decimation_of: int = setting(
        1, '... of every so many frames are processed, the others as if never seen; 2 of 5: pairs for the flow, and '
        'time to process them', low=1, high=1000, unit='frames')
    adapt: bool = setting(
        False, 'less work by known steps while images take longer than their period; separate nodes follow ego_motion')
    threads: int = setting(
        0, 'threads that work on a frame, 0 = as many as there are cores; with 1 nothing is done side by side or '
        'behind an answer', low=0, high=256)

    def __post_init__(self) -> None:
        if self.decimation_keep > self.decimation_of:
            raise ConfigError(f'load.decimation_keep: expected at most load.decimation_of ({self.decimation_of}), '
                              f'got {self.decimation_keep}')


@dataclass(frozen=True)
class PipelineConfig:
    """All stages. ``PipelineConfig()`` is the default preset."""

    preprocessing: PreprocessingConfig = PreprocessingConfig()
    ego_motion: EgoMotionConfig = EgoMotionConfig()
    imu: ImuConfig = ImuConfig()
    optical_flow: OpticalFlowConfig = OpticalFlowConfig()
    background: BackgroundConfig = BackgroundConfig()
    art2: Art2Config = Art2Config()
    objects: ObjectsConfig = ObjectsConfig()
    trajectories: TrajectoriesConfig = TrajectoriesConfig()
    tracks: TracksConfig = TracksConfig()
    load: LoadConfig = LoadConfig()
    self_tuning: SelfTuningConfig = field(default_factory=SelfTuningConfig)
