"""The data that stages exchange. Pixels are full-resolution image pixels unless said otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from threading import Lock
from time import perf_counter

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]
DoubleArray = npt.NDArray[np.float64]
ByteArray = npt.NDArray[np.uint8]
BoolArray = npt.NDArray[np.bool_]
RecordArray = npt.NDArray[np.void]

NANOSECONDS = 1_000_000_000
#: The latest time that a message of ROS can carry, ns: its seconds are int32 (2038-01-19).
LATEST_STAMP_NS = 2 ** 31 * NANOSECONDS - 1

#: The highest id of a track, or name of a neuron, which are uint32; after it comes 1 again.
MAX_ID = 0xFFFFFFFF

#: One detected object; the same fields, in this order, travel in the ``detections`` topic.
DETECTION_DTYPE = np.dtype([
    ('u', '<f4'), ('v', '<f4'),                      # box centre, pixels
    ('width', '<f4'), ('height', '<f4'),             # pixels
    ('vel_u', '<f4'), ('vel_v', '<f4'),              # pixels/s, ego-motion removed
    ('var_u', '<f4'), ('var_v', '<f4'),              # variance of the velocity, (pixels/s)^2
    ('score', '<f4'),                                # 0..1
    ('ttc', '<f4'),                                  # s; +inf not approaching, NaN unknown
    ('bearing_x', '<f4'), ('bearing_y', '<f4'), ('bearing_z', '<f4'),  # unit ray, optical frame; NaN uncalibrated
    ('id', '<u4'),                                   # confirmed track, not reused in a run but for lost_tracks
    ('age', '<u4'),                                  # frames in which a motion was known, since it was first seen
    ('area', '<f4'),                                 # pixels of the object's mask
    ('cluster', '<u4'),                              # ART2 neuron of the object
])

#: One box of ground truth: ``moving`` is 1 moving, 0 static, -1 ignored.
TRUTH_DTYPE = np.dtype([
    ('frame', '<i4'), ('id', '<i4'),
    ('x', '<f8'), ('y', '<f8'), ('w', '<f8'), ('h', '<f8'),  # top left corner and size, pixels
    ('moving', '<i1'),
])


class EgoStatus(IntEnum):
    """Whether there is an ego-motion estimate, and why not. Anything but OK comes with an identity matrix."""

    OK = 0
    FIRST_FRAME = 1
    LOW_TEXTURE = 2
    DEGENERATE = 3
    OUTLIER_GATED = 4
    TIME_JUMP = 5
    SIZE_CHANGE = 6


class MotionModel(IntEnum):
    """Which family of warps the ego-motion matrix comes from."""

    TRANSLATION = 0
    SIMILARITY = 1
    AFFINE = 2
    HOMOGRAPHY = 3
    QUADRATIC = 4


@dataclass(frozen=True)
class CameraModel:
    """A camera: focal lengths and principal point in pixels of a ``width`` x ``height`` image, and its lens.

    ``distortion``: coefficients as OpenCV takes them, none for a pinhole; ``fisheye``: those of the equidistant model.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    fisheye: bool = False

    @classmethod
    def of(cls, width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> CameraModel | None:
        """The camera; None where the values are no calibration: not finite, or a focal length under a pixel."""
        if not all(math.isfinite(value) for value in (fx, fy, cx, cy)) or min(fx, fy) < 1.0:
            return None
        return cls(width, height, fx, fy, cx, cy)

    @classmethod
    def guessed(cls, width: int, height: int, focal_share: float) -> CameraModel:
        """A camera with its principal point at the image centre, focal length a share of the width."""
        focal = focal_share * width
        return cls(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)

    @property
    def matrix(self) -> DoubleArray:
        """(3, 3) K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> CameraModel:
        """The same camera read out at another size; pixel centres sit at whole numbers.

        A camera of unknown size is taken to be of this size.
        """
        if not self.width or not self.height:
            return replace(self, width=width, height=height)
        if (width, height) == (self.width, self.height):
            return self
        across, down = width / self.width, height / self.height
        return replace(self, width=width, height=height, fx=self.fx * across, fy=self.fy * down,
                       cx=(self.cx + 0.5) * across - 0.5, cy=(self.cy + 0.5) * down - 0.5)


@dataclass(frozen=True)
class PreparedFrame:
    """A frame after preprocessing.

    ``gray``: (h, w) uint8 at the working resolution; ``scale`` = working / full resolution;
    ``width, height``: full resolution, pixels; ``stamp_ns``: time of the source, nanoseconds; ``mask``: (h, w), False
    where the image does not show the scene (text, own hull), None = it does everywhere.
    """

    gray: ByteArray
    scale: float
    width: int
    height: int
    stamp_ns: int
    mask: BoolArray | None = None


@dataclass(frozen=True)
class RelativePose:
    """How the camera moved between two frames, static points X in camera coordinates: X_now = R X_previous + t.

    The length of t is not observable with one camera: it is the unit of length here.

    ``rotation``: (3, 3) R; ``direction``: (3,) t, unit vector, the camera travels along -t (current camera's axes);
    ``epipole``: (2,) full-resolution pixels of the current frame, where static points flow out of (or into); not finite
    where the camera travels parallel to the image; ``ground``: (3,) g with g . X_now = 1 on the ground, so g / |g| is
    its normal, away from the camera, 1 / |g| the camera's height over it, and g . (x, y, 1) the inverse depth of the
    ground at normalised (x, y); None where no ground is visible.
    """

    rotation: DoubleArray
    direction: DoubleArray
    epipole: DoubleArray
    ground: DoubleArray | None = None


@dataclass(frozen=True)
class EgoMotion:
    """Motion of the background between two frames.

    ``matrix``: (3, 3) float64, maps previous pixel -> current pixel (full resolution).
    ``covariance``: (6, 6) float64 of the affine parameters (a0 .. a5), see ``core.geometry.affine``.
    ``residual_px``: median distance of the inliers to the model. ``camera``: None = not enabled or not determined;
    it does not depend on ``status``, which refers to ``matrix``. ``load_step``: number of the step
    (``core.load_control``) at which the frame was worked on.
    """

    matrix: DoubleArray
    covariance: DoubleArray
    status: EgoStatus
    stamp_ns: int
    prev_stamp_ns: int
    inliers: int = 0
    tracks: int = 0
    residual_px: float = float('nan')
    model: MotionModel = MotionModel.AFFINE
    camera: RelativePose | None = None
    load_step: int = 0

    @property
    def dt_s(self) -> float:
        """Time between the two frames, seconds (0 on a first frame)."""
        return (self.stamp_ns - self.prev_stamp_ns) / NANOSECONDS

    @property
    def passed_over(self) -> bool:
        """True where the image told no motion; that into a later frame may start from before it."""
        return self.status in (EgoStatus.LOW_TEXTURE, EgoStatus.DEGENERATE, EgoStatus.OUTLIER_GATED)

    @property
    def ok(self) -> bool:
        """True where ``matrix`` is an estimate."""
        return self.status == EgoStatus.OK


class FlowField:
    """Dense optical flow on a grid, known or to be computed where it is first asked for.

    ``flow``: (gh, gw, 2) float32, total displacement (dx, dy) in full-resolution pixels from the earlier frame
    to the frame of ``stamp_ns``, sampled on the later frame's grid; NaN = invalid.
    Grid cell (r, c) covers full-resolution pixels [c*sx, (c+1)*sx) x [r*sy, (r+1)*sy), sx = width / gw,
    sy = height / gh.
    """

    def __init__(
        self, flow: FloatArray | Callable[[], FloatArray], width: int, height: int, stamp_ns: int,
    ) -> None:
        """flow: or what computes it, called once, whether or not it raises."""
        self._flow = flow
        self._error: Exception | None = None
        self._lock = Lock()
        self.width, self.height, self.stamp_ns = width, height, stamp_ns
        self.took_ms, self.clock = 0.0, perf_counter

    @property
    def flow(self) -> FloatArray:
        """The displacements; any thread may ask. Raises: what computing them raises."""
        return self.settle()

    def settle(self) -> FloatArray:
        """Compute it, where it is pending, and other threads wait; ``took_ms``: how long that took by
        ``clock``, ms.
        """
        with self._lock:
            if self._error is not None:
                raise self._error
            if callable(self._flow):
                start = self.clock()
                try:
                    self._flow = self._flow()
                except Exception as error:
                    self._error = error
                    raise
                self.took_ms = 1e3 * (self.clock() - start)
            return self._flow

    @property
    def pending(self) -> bool:
        """Whether it is yet to be computed."""
        return callable(self._flow)

    @property
    def measured(self) -> bool:
        """Whether any of it is known: not in frames without a reference, and between flows (``every_s``)."""
        return bool(np.isfinite(self.flow).any())


@dataclass(frozen=True)
class StageTimes:
    """Compute time of each stage to the answer of one frame, milliseconds; not of what is done behind it."""

    preprocessing: float = 0.0
    ego_motion: float = 0.0
    optical_flow: float = 0.0
    clustering: float = 0.0

    @property
    def total(self) -> float:
        """Sum of the stages, milliseconds."""
        return self.preprocessing + self.ego_motion + self.optical_flow + self.clustering


@dataclass(frozen=True)
class Result:
    """What ``MotionPipeline.process`` returns for one frame; ``detections`` has dtype ``DETECTION_DTYPE``."""

    stamp_ns: int
    ego: EgoMotion
    flow: FlowField
    detections: RecordArray
    times_ms: StageTimes = field(default_factory=StageTimes)


def empty_detections(count: int = 0) -> RecordArray:
    """``count`` detections of dtype ``DETECTION_DTYPE``, zero filled, time to contact and bearing unknown (NaN)."""
    records = np.zeros(count, DETECTION_DTYPE)
    for name in ('ttc', 'bearing_x', 'bearing_y', 'bearing_z'):
        records[name] = np.nan
    return records
