"""From segments of clustered cells to candidate objects, with boxes fitted on the images."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.image_pair import ImagePair, image_noise
from motion_detect_ros.core.detection.motion_field import MotionField, cells_of
from motion_detect_ros.core.detection.patches import Patch, parted_patch
from motion_detect_ros.core.detection.photometric import PhotometricTest, Place, photometric_tests, reach_px
from motion_detect_ros.core.detection.prediction_errors import PredictionErrors
from motion_detect_ros.core.detection.scoring import LEAST_LOG_ODDS, log_odds
from motion_detect_ros.core.detection.segment_patches import CellEdges, JoinLimits, segment_patches
from motion_detect_ros.core.detection.segments import Segment
from motion_detect_ros.core.detection.several_objects import LARGER, UsualSize
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import FloatArray

#: A segment's surroundings that its object may reach into besides its motion, working-resolution pixels.
MARGIN_PX = 3
#: The same before a three-dimensional background, share of the segment's size: only the part of an object that is below
#: the ground's depth gives it away, what stands above that part may be as large.
SPACE_MARGIN_SHARE = 0.5
#: Parts of one near body may lie apart from this share of the image on: limbs. Cars side by side cover less, and only
#: what covers less is taken for several objects.
NEAR_SHARE = 0.05
#: All parts of one segment are one body where the box around them is at least this share of the image: of plain fur and
#: clothes only edges give themselves away. Vehicles that drive alike, seen from above, make segments of up to 0.1, and
#: more where the camera is low: where points are tracked, which tell them apart, parts are left as they are.
BODY_SHARE = 0.15
#: So many objects in a frame tell which size is usual: fewer may be the pieces of a single near body.
LEAST_OBJECTS = 10
#: Fewest segments worth a thread.
LEAST_SEGMENTS = 20


def is_allowed(sides: Sequence[float], image_area: int, config: ObjectsConfig) -> bool:
    """Whether the settings allow a box of two such sides in an image, working-resolution pixels."""
    return min(sides) >= config.min_side_px and math.prod(sides) <= config.max_area_share * image_area


class ObjectFinder:
    """Tests every segment on the images and fits its boxes. with_bodies: large segments are one object each."""

    def __init__(self, config: ObjectsConfig, with_bodies: bool = True) -> None:
        self._config = config
        self._body_share = BODY_SHARE if with_bodies else math.inf
        self._usual = UsualSize(LEAST_OBJECTS)

    def reset(self) -> None:
        """Another scene."""
        self._usual.reset()

    def find(
        self, segments: list[Segment], field: MotionField, pair: ImagePair, names: npt.NDArray[np.uint32],
        stamp_ns: int,
    ) -> list[Candidate]:
        """Candidates in full-resolution pixels, those that say less against an object than a frame without one would.

        names: (K,) number of each ART2 neuron; stamp_ns: of the current picture of ``pair``.
        """
        if not segments:
            return []
        grid, (height, width) = field.residual.shape[:2], pair.current.shape
        background_flow = field.background.flow * np.float32(field.scale)
        noise_gray = image_noise(pair, grid_points(*grid, width, height), background_flow)
        places = [_place(segment, field, motion, against, width, height)
                  for segment, (motion, against) in zip(segments, field.motions_of(segments), strict=True)]
        background = PredictionErrors.near(
            pair, [each.region.grown(each.reach, width, height) for each in places], background_flow)
        parts = HELPERS.parts(len(segments), LEAST_SEGMENTS)
        tests = photometric_tests(pair, background, places, noise_gray, self._config.photometric_sigma, parts)
        limits = self._limits(width * height) if field.background.smooth else JoinLimits()
        patches = segment_patches(tests, segments, CellEdges.of(grid, (height, width)), self._config, limits, parts)
        if field.background.smooth:  # before one in space the test reaches far beside the segment, where flow leaks
            patches = [self._parted(patches[n], limits.near_area, segment, tests[n], places[n].region, grid,
                                    (height, width)) for n, segment in enumerate(segments)]
        patches = [[patch.moved(place.region.left, place.region.top) for patch in each
                    if is_allowed((patch.box.width, patch.box.height), width * height, self._config)]
                   for each, place in zip(patches, places, strict=True)]
        found = _candidates([patch for each in patches for patch in each], field, (height, width), [
            int(names[segment.neuron]) for segment, each in zip(segments, patches, strict=True) for _ in each])
        self._usual.add([float(each.size.prod()) * field.scale ** 2 for each in found if each.log_odds > 0.0],
                        stamp_ns)
        return found

    def _limits(self, image_area: int) -> JoinLimits:
        return JoinLimits(self._body_share * image_area, self._config.max_area_share * image_area,
                          NEAR_SHARE * image_area)

    def _parted(
        self, patches: list[Patch], near_area: float, segment: Segment, test: PhotometricTest, region: Box,
        grid: tuple[int, int], size: tuple[int, int],
    ) -> list[Patch]:
        """Those of a segment, each of what holds several objects; grid, size: rows and columns, height and width."""
        usual_area = self._usual.area
        if usual_area is None or not any(LARGER * usual_area <= patch.box.area < near_area for patch in patches):
            return patches
        own = segment.pixels(region, grid, size)
        return [part for patch in patches
                for part in parted_patch(patch, test.foreground, own, usual_area, near_area)]


def _place(
    segment: Segment, field: MotionField, motion: FloatArray, against: FloatArray, width: int, height: int,
) -> Place:
    """Where in a ``width`` x ``height`` image a segment's object is looked for: of fast ones flow is known on a part.

    motion, against: (2,) beyond the ego-motion, and against the background.
    """
    reach = reach_px(against)
    rows, columns = field.residual.shape[:2]
    cells = segment.box
    box = Box(cells.left * width // columns, cells.top * height // rows,
              -(-cells.right * width // columns), -(-cells.bottom * height // rows))
    margin = MARGIN_PX + reach
    if not field.background.smooth:
        margin = max(margin, round(SPACE_MARGIN_SHARE * min(box.width, box.height)))
    return Place(box.grown(margin, width, height), reach, motion)


def _candidates(
    patches: list[Patch], field: MotionField, size: tuple[int, ...], names: list[int],
) -> list[Candidate]:
    """What each patch of an image of this height and width is, and how it moves, where it may be an object at all;
    names: of their neurons.
    """
    if not patches:
        return []
    boxes = np.array([each.box.edges for each in patches])
    cells = cells_of(boxes, field.residual.shape[:2], size)
    motions, sigmas, known = field.object_motions(cells)
    around = field.known_around(cells)
    centres, sizes = (boxes[:, :2] + boxes[:, 2:]) / (2.0 * field.scale), (boxes[:, 2:] - boxes[:, :2]) / field.scale
    velocities = motions.astype(np.float64) / field.seconds
    odds = [log_odds(patch.pixels / size[1] ** 2, *figures) for patch, *figures in zip(
        patches, sigmas.tolist(), known.tolist(), around.tolist(), strict=True)]
    return [Candidate(centre, extent, velocity, patch.pixels / field.scale ** 2, likely, name)
            for centre, extent, velocity, patch, likely, name in zip(
                centres, sizes, velocities, patches, odds, names, strict=True) if likely >= LEAST_LOG_ODDS]
