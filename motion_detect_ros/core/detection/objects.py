"""From segments of clustered cells to candidate objects, with boxes fitted on the images."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.image_pair import ImagePair, image_noise
from motion_detect_ros.core.detection.motion_field import MotionField
from motion_detect_ros.core.detection.patches import Patch, connected_pixels, joined_patches, parted_patch, whole_body
from motion_detect_ros.core.detection.photometric import PhotometricTest, photometric_test, reach_px
from motion_detect_ros.core.detection.scoring import log_odds
from motion_detect_ros.core.detection.segments import Segment
from motion_detect_ros.core.detection.several_objects import LARGER, UsualSize
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.order_statistics import percentile
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.threads import HELPERS

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
#: Fewer foreground pixels than this are noise.
MIN_PIXELS = 8
#: The gain that a patch's strongest pixels reach, as a percentile.
PEAK_PERCENTILE = 90.0
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
        """Candidates in full-resolution pixels.

        names: (K,) number of each ART2 neuron; stamp_ns: of the current picture of ``pair``.
        """
        if not segments:
            return []
        rows, columns = field.residual.shape[:2]
        height, width = pair.current.shape
        background_flow = field.background.flow * np.float32(field.scale)
        noise_gray = image_noise(pair, grid_points(rows, columns, width, height), background_flow)
        count = HELPERS.parts(len(segments), LEAST_SEGMENTS)
        found: list[list[Candidate]] = [[] for _ in segments]

        def every(first: int) -> None:  # the largest segments are neighbours in the list
            for index in range(first, len(segments), count):
                found[index] = [self._candidate(patch, field, pair, int(names[segments[index].neuron]))
                                for patch in self._patches(segments[index], field, pair, noise_gray)]

        HELPERS.share(every, range(count))
        candidates = [candidate for each in found for candidate in each]
        self._usual.add([float(each.size.prod()) * field.scale ** 2 for each in candidates if each.log_odds > 0.0],
                        stamp_ns)
        return candidates

    def _patches(self, segment: Segment, field: MotionField, pair: ImagePair, noise_gray: float) -> list[Patch]:
        """Foreground patches around one segment, working-resolution pixels."""
        height, width = pair.current.shape
        motion, object_motion = field.motions_of(segment)
        reach = reach_px(object_motion)
        region = self._region(segment, field, reach, width, height)
        window = region.grown(reach, width, height)
        test = photometric_test(
            pair, region, window, field.background_flow(window, width, height), motion, noise_gray,
            self._config.photometric_sigma)
        found = self._patches_of(test, segment, Box(region.left, region.top, width, height), field.residual.shape[:2])
        near_area, usual_area = math.inf, None
        if field.background.smooth:  # before one in space the test reaches far beside the segment, where flow leaks
            near_area, usual_area = NEAR_SHARE * width * height, self._usual.area
            found = whole_body(found, self._body_share * width * height, self._config.max_area_share * width * height)
        found = joined_patches(found, near_area)
        if usual_area is not None and any(LARGER * usual_area <= patch.box.area < near_area for patch in found):
            own = segment.pixels(region, field.residual.shape[:2], (height, width))
            found = [part for patch in found
                     for part in parted_patch(patch, test.foreground, own, usual_area, near_area)]
        return [patch.moved(region.left, region.top) for patch in found
                if is_allowed((patch.box.width, patch.box.height), width * height, self._config)]

    @staticmethod
    def _region(segment: Segment, field: MotionField, reach: int, width: int, height: int) -> Box:
        """Region that the object may cover: of fast objects flow is known on a part only."""
        rows, columns = field.residual.shape[:2]
        cells = segment.box
        box = Box(cells.left * width // columns, cells.top * height // rows,
                  -(-cells.right * width // columns), -(-cells.bottom * height // rows))
        margin = MARGIN_PX + reach
        if not field.background.smooth:
            margin = max(margin, round(SPACE_MARGIN_SHARE * min(box.width, box.height)))
        return box.grown(margin, width, height)

    def _patches_of(self, test: PhotometricTest, segment: Segment, place: Box, grid: tuple[int, ...]) -> list[Patch]:
        """Patches that touch the segment, cut down to the pixels near their strongest gain.

        A soft shadow moves with its object, but its gain is far below that of the object's own edges. place: of the
        test's left upper pixel to the right lower end of the image; grid: rows and columns of cells of the image.
        """
        count, labels = connected_pixels(test.foreground, self._config.closing_px)
        patches = np.zeros((count, 5), np.int64)
        _fill_patches(labels, test.foreground, test.gain, segment.rows, segment.columns, grid[0], grid[1], place.left,
                      place.top, place.right, place.bottom, np.float32(self._config.peak_share),
                      np.zeros((2, count + 1), np.int64), np.empty(labels.size, np.float32),
                      np.zeros(count, np.bool_), np.empty(count, np.float32), patches)
        return [Patch(Box(*row[:4]), row[4]) for row in patches.tolist() if row[4] >= MIN_PIXELS]

    @staticmethod
    def _candidate(patch: Patch, field: MotionField, pair: ImagePair, name: int) -> Candidate:
        box, scale = patch.box, field.scale
        rows, columns = field.residual.shape[:2]
        height, width = pair.current.shape
        cells = (slice(box.top * rows // height, -(-box.bottom * rows // height)),
                 slice(box.left * columns // width, -(-box.right * columns // width)))
        motion, sigmas, known = field.object_motion(*cells)
        around = field.known_around(*cells)
        centre = np.array([box.left + box.right, box.top + box.bottom]) / (2.0 * scale)
        size = np.array([box.width, box.height]) / scale
        return Candidate(centre, size, motion.astype(np.float64) / field.seconds, patch.pixels / scale ** 2,
                         log_odds(patch.pixels / width ** 2, sigmas, known, around), name)


@kernel()
def _fill_patches(  # type: ignore[no-untyped-def]
    labels, mask, gain, cell_rows, cell_columns, grid_rows, grid_columns, left, top, width, height, peak_share, places,
    gains, touches, limits, patches,
):
    """``patches``: (count, 5) left, top, right, bottom, number of the pixels near the peak gain of each label; number 0
    where the label does not touch the cells (n,) of a grid over a ``width`` x ``height`` image or is too small.

    labels, mask, gain: (h, w), at left, top of it; places: (2, count + 1) zeros, where the pixels of each label begin
    in ``gains`` (h * w,), and are filled so far; touches: (count,) False; limits: (count,).
    """
    rows, columns = labels.shape
    starts = places[0]
    _gather(labels, mask, gain, starts, places[1], gains)
    for n in range(len(cell_rows)):
        r, c = cell_rows[n], cell_columns[n]
        y0, y1 = -(-r * height // grid_rows) - top, -(-(r + 1) * height // grid_rows) - top
        x0, x1 = -(-c * width // grid_columns) - left, -(-(c + 1) * width // grid_columns) - left
        _note_touched(labels, mask, max(0, y0), min(rows, y1), max(0, x0), min(columns, x1), touches)
    for label in range(len(limits)):
        limits[label], patches[label, 0], patches[label, 1] = np.inf, columns, rows
        if touches[label] and starts[label + 1] - starts[label] >= MIN_PIXELS:
            limits[label] = peak_share * percentile(gains[starts[label]:starts[label + 1]], PEAK_PERCENTILE)
    for y in range(rows):
        for x in range(columns):
            if mask[y, x] and gain[y, x] > limits[labels[y, x]]:
                label = labels[y, x]
                patches[label, 0], patches[label, 1] = min(patches[label, 0], x), min(patches[label, 1], y)
                patches[label, 2], patches[label, 3] = max(patches[label, 2], x + 1), max(patches[label, 3], y + 1)
                patches[label, 4] += 1


@kernel()
def _gather(labels, mask, gain, starts, filled, gains):  # type: ignore[no-untyped-def]
    """``gains``: of the pixels of label after label, which begin at ``starts``, (count + 1,) zeros like ``filled``."""
    rows, columns = labels.shape
    for y in range(rows):
        for x in range(columns):
            if mask[y, x]:
                starts[labels[y, x] + 1] += 1
    for label in range(len(starts) - 1):
        starts[label + 1] += starts[label]
        filled[label] = starts[label]
    for y in range(rows):
        for x in range(columns):
            if mask[y, x]:
                label = labels[y, x]
                gains[filled[label]] = gain[y, x]
                filled[label] += 1


@kernel()
def _note_touched(labels, mask, top, bottom, left, right, touches):  # type: ignore[no-untyped-def]
    """``touches``: True at the labels of pixels in a window."""
    for y in range(top, bottom):
        for x in range(left, right):
            touches[labels[y, x]] |= mask[y, x]
