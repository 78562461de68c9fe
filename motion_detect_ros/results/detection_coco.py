"""coco.json: detections as the annotations of a COCO data set, with scores, for tools that label and evaluate."""

from __future__ import annotations

import json
from array import array
from pathlib import Path

import motion_detect_ros
from motion_detect_ros.results.detection_writer import FrameDetections, finite
from motion_detect_ros.results.files import COCO_NAME, TextFile
from motion_detect_ros.results.metrics import boxes_of
from motion_detect_ros.sources.part_file import PartFile

CATEGORY = {'id': 1, 'name': 'moving', 'supercategory': 'object'}
DECIMALS = 5


class CocoDetections(PartFile):
    """Annotations as they come, the images at the end: 24 bytes of each frame are kept until then.

    ``annotations`` with their scores are also what ``COCO.loadRes`` of pycocotools takes. Left by an exception, the
    part is whole JSON of everything written so far; a part whose process was killed ends without the images.
    Format: https://cocodataset.org/#format-data, https://cocodataset.org/#format-results.
    """

    def __init__(self, folder: Path, source: str) -> None:
        """source: the input, for the description. Raises: SourceError where the file cannot be written."""
        super().__init__(folder / COCO_NAME)
        self._frames, self._stamps_ns = array('q'), array('q')
        self._widths, self._heights = array('i'), array('i')
        self._annotations = 0
        self._file = TextFile(self.path)
        info = {'description': f'moving objects in {source}', 'version': motion_detect_ros.__version__}
        self._file.add(f'{{"info": {json.dumps(info)},')
        self._file.add(f'"categories": [{json.dumps(CATEGORY)}],')
        self._file.add('"annotations": [')

    def write(self, found: FrameDetections) -> None:
        """Add the annotations of one frame, and the frame as an image."""
        self._frames.append(found.frame)
        self._stamps_ns.append(found.stamp_ns)
        self._widths.append(found.size[0])
        self._heights.append(found.size[1])
        records = finite(found.records)
        for record, box in zip(records, boxes_of(records), strict=True):
            comma, self._annotations = ',' * (self._annotations > 0), self._annotations + 1
            x, y, width, height = (round(float(number), DECIMALS) for number in box)
            self._file.add(comma + json.dumps({
                'id': self._annotations, 'image_id': found.frame, 'category_id': CATEGORY['id'],
                'bbox': [x, y, width, height], 'area': round(width * height, DECIMALS), 'iscrowd': 0,
                'score': round(float(record['score']), DECIMALS), 'track_id': int(record['id'])}))

    def finish_part(self) -> None:
        """Add the images and close the file under its part name."""
        try:
            self._add_images()
        finally:
            self._file.finish_part()

    def _add_images(self) -> None:
        self._file.add('],')
        self._file.add('"images": [')
        images = zip(self._frames, self._stamps_ns, self._widths, self._heights, strict=True)
        for number, (frame, stamp_ns, width, height) in enumerate(images):
            self._file.add(',' * (number > 0) + json.dumps({
                'id': frame, 'file_name': f'{frame:06d}.jpg', 'width': width, 'height': height, 'stamp_ns': stamp_ns}))
        self._file.add(']}')
