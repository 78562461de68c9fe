"""A synthetic flight: any frame on demand, with everything that is true of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import (
    NANOSECONDS,
    BoolArray,
    ByteArray,
    CameraModel,
    DoubleArray,
    FloatArray,
    RecordArray,
)
from motion_detect_ros.sources.synthetic import effects, raster, shading, truth
from motion_detect_ros.sources.synthetic.camera_path import CameraPath
from motion_detect_ros.sources.synthetic.config import FlightConfig
from motion_detect_ros.sources.synthetic.ground import paint_ground
from motion_detect_ros.sources.synthetic.scene import View, look, make_scene
from motion_detect_ros.sources.synthetic.textures import Atlas, build_atlas, canopy_masks, materials
from motion_detect_ros.sources.synthetic.town import build_town


@dataclass(frozen=True)
class SyntheticFrame:
    """One picture and its truth. Pixel centres are at whole coordinates; ``previous`` is frame ``index`` - 1.

    image: (H, W, 3) uint8 BGR. stamp_ns: nanoseconds. camera, intrinsic (3, 3) float64: of this frame (zoom).
    truth: records of ``TRUTH_DTYPE``, one per visible car, person or box, sorted by id. ttc: (n,) float64, seconds to
    contact of each record, +inf not approaching. ground_homography: (3, 3) float64, previous pixel -> this pixel of
    the ground plane. flow: (H, W, 2) float32, pixels moved since the previous frame by what each pixel of this frame
    shows, NaN where that was hidden or outside then. rotation (3, 3), translation (3,) metres: X = rotation @
    X_previous + translation in the optical frame. Frame 0 has no previous one: identity, no translation, flow NaN.
    owner: (H, W) int32, id of the object each pixel belongs to, 0 = scenery.
    """

    index: int
    image: ByteArray
    stamp_ns: int
    camera: CameraModel
    truth: RecordArray
    ttc: DoubleArray
    ground_homography: DoubleArray
    flow: FloatArray
    rotation: DoubleArray
    translation: DoubleArray
    intrinsic: DoubleArray
    owner: raster.Ids


@dataclass(frozen=True)
class _Drawn:
    """What of one instant does not depend on any other: the view and what it shows, at two samples a pixel."""

    index: int
    view: View
    ids: raster.Ids
    nearness: FloatArray


def _scenery(config: FlightConfig) -> FlightConfig:
    """What of ``config`` the textures depend on: flights that differ in camera or movers only share them."""
    return FlightConfig(
        seed=config.seed, ground=config.ground, ground_contrast=config.ground_contrast,
        buildings=config.buildings, trees=config.trees, cars=0, parked_cars=0, people=0)


@lru_cache(maxsize=2)
def _atlas(scenery: FlightConfig) -> Atlas:
    """All textures; painting the ground is nine tenths of the cost of a new flight."""
    return build_atlas([paint_ground(scenery, build_town(scenery)), *materials(scenery.seed)])


class SyntheticFlight:
    """A sequence of ``SyntheticFrame``; the same config gives the same bytes, in whatever order frames are asked for.

    Raises: ConfigError where the config's course takes the camera too low.
    """

    def __init__(self, config: FlightConfig | None = None) -> None:
        self.config = config or FlightConfig()
        self._path = CameraPath(self.config)
        self.scene = make_scene(build_town(self.config).bodies)
        self._masks: BoolArray = canopy_masks(self.config.seed)
        self._paint = shading.make_paint(self.scene, _atlas(_scenery(self.config)))
        self._latest: _Drawn | None = None

    def __len__(self) -> int:
        return self.config.frames

    def __iter__(self) -> Iterator[SyntheticFrame]:
        return (self.frame(index) for index in range(len(self)))

    @property
    def name(self) -> str:
        """Short name, fit for a folder."""
        return f'synthetic_{self.config.seed}'

    @property
    def camera(self) -> CameraModel:
        """Calibration of frame 0; with ``zoom_share`` over 0 every frame has its own, see ``SyntheticFrame.camera``."""
        return self._path.pose(0).model(self.config.width, self.config.height)

    def stamp_ns(self, index: int) -> int:
        """Time of frame ``index``, nanoseconds."""
        return self.config.start_stamp_ns + round(index * NANOSECONDS / self.config.fps)

    def frame(self, index: int) -> SyntheticFrame:
        """Draw frame ``index`` and work out its truth. Asking in order saves drawing the previous one again.

        Raises: SourceError for an index outside the flight.
        """
        if not 0 <= index < len(self):
            raise SourceError(f'frame {index}: expected 0 to {len(self) - 1}')
        previous, current = self._draw(index - 1), self._draw(index)
        self._latest = current
        owner = raster.owners(current.ids, current.nearness, self.scene.body)
        flow, seen = truth.exact_flow(self.scene, current.view, previous.view, owner, previous.ids)
        image = shading.shade(self.scene, current.view, self._paint, current.ids)
        image = effects.motion_blur(image, flow, self.config.blur)
        return self._assemble(previous.view, current, owner, effects.expose(image, self.config, index), flow, seen)

    def _draw(self, index: int) -> _Drawn:
        if self._latest is not None and self._latest.index == index:
            return self._latest
        width, height = self.config.width, self.config.height
        view = look(self.scene, self._path.pose(index), width, height)
        return _Drawn(index, view, *raster.visible_patches(self.scene, view, self._masks, width, height))

    def _assemble(
        self, previous: View, drawn: _Drawn, owner: raster.Ids, image: ByteArray, flow: FloatArray, seen: BoolArray,
    ) -> SyntheticFrame:
        pose, before = drawn.view.pose, previous.pose
        boxes, bodies = truth.truth_boxes(self.scene, drawn.view, owner, self._masks, drawn.index)
        ttc = [truth.time_to_contact(self.scene, int(b), before, pose, drawn.view.position[b]) for b in bodies]
        ground, (rotation, translation) = truth.ground_homography(before, pose), truth.relative_motion(before, pose)
        flow[~seen] = np.nan
        if drawn.index == 0:
            ground, rotation, translation = np.eye(3), np.eye(3), np.zeros(3)
            flow[:] = np.nan
        ident = np.where(owner >= 0, self.scene.ident[self.scene.body[np.maximum(owner, 0)]], 0)
        return SyntheticFrame(
            drawn.index, image, self.stamp_ns(drawn.index), pose.model(self.config.width, self.config.height), boxes,
            np.array(ttc), ground, flow, rotation, translation, pose.intrinsic,
            ident.astype(np.int32))
