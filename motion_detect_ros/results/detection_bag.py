"""detections.mcap: what was found as ROS messages, with their definitions, so that tools without ROS show them."""

from __future__ import annotations

from pathlib import Path

import cv2

from motion_detect_ros.core.drawing import draw_detections, line_px
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.results.detection_writer import FrameDetections, finite
from motion_detect_ros.results.files import BAG_NAME
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.box_messages import detection_array, image_annotations
from motion_detect_ros.sources.part_file import PartFile

#: Topics as the nodes name them.
RECORDS_TOPIC, BOXES_TOPIC, OVERLAY_TOPIC = '/detections', '/detections_2d', '/overlay/overlay/compressed'
#: What Foxglove draws on the pictures; the nodes have none.
ANNOTATIONS_TOPIC = '/annotations'
#: Small, so that a replay that is killed leaves what it did up to a second or so before, and large enough that the
#: index of the chunks, which stays in memory, takes no more than a few megabytes for hours.
CHUNK_BYTES = 32_768
JPEG_QUALITY = 85


class BagDetections(PartFile):
    """For every frame its records, its boxes, the same for Foxglove, and its picture with boxes where there is one."""

    def __init__(self, folder: Path, source: str) -> None:
        """Raises: SourceError where the file cannot be written. source: not used."""
        super().__init__(folder / BAG_NAME)
        self._bag = BagWriter(self.path, chunk_bytes=CHUNK_BYTES)

    def write(self, found: FrameDetections) -> None:
        """Add the messages of one frame, also where nothing was found. Raises: BackendError as ``jpeg``."""
        self._bag.write_detections(found.records, found.stamp_ns, RECORDS_TOPIC, found.frame_id)
        self._bag.write(BOXES_TOPIC, detection_array(found.records, found.stamp_ns, found.frame_id), found.stamp_ns)
        annotations = image_annotations(finite(found.records), found.stamp_ns, line_px(found.size[0]))
        self._bag.write(ANNOTATIONS_TOPIC, annotations, found.stamp_ns)
        if found.image is not None:
            picture = jpeg(draw_detections(found.image, found.records))
            self._bag.write_compressed(picture, 'jpeg', found.stamp_ns, OVERLAY_TOPIC, found.frame_id)

    def finish_part(self) -> None:
        """Close the bag properly under its part name."""
        self._bag.finish_part()


def jpeg(image: ByteArray) -> bytes:
    """A picture, (H, W, 3) uint8 BGR, as a JPEG file. Raises: BackendError where this OpenCV writes none."""
    done, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise BackendError(f'this OpenCV cannot write a picture of shape {image.shape} as JPEG')
    return bytes(data)
