"""Write bags: one MCAP file that ``ros2 bag play`` and Foxglove read, appearing under its name when complete."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import ByteArray, CameraModel, DoubleArray, RecordArray
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.frames import CAMERA_FRAME
from motion_detect_ros.sources.part_file import PartFile, locked_file

CHUNK_BYTES = 1 << 20


class BagWriter(PartFile):
    """An MCAP file under construction; use as a context manager.

    It is written to ``<path>.part`` and renamed when complete. If the block is left by an exception the part is
    closed properly and stays: it is a readable bag of everything written so far.
    """

    def __init__(self, path: str | Path, compress: bool = True, chunk_bytes: int = CHUNK_BYTES) -> None:
        """compress: zstd for the chunks; off suits pictures, which hardly shrink. Raises: SourceError, where another
        process writes the same file too.

        chunk_bytes: what is collected before it is written; if the process is killed that much is lost.
        """
        super().__init__(Path(path))
        self.message_count = 0
        self._channels: dict[tuple[str, str], int] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = os.fdopen(locked_file(self.part_path), 'wb')
            self._stream.truncate(0)
        except BlockingIOError:
            raise SourceError(f'{self.part_path}: is being written by another process') from None
        except OSError as error:
            raise SourceError(f'{self.part_path}: cannot be written: {error.strerror}') from None
        compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._writer = Writer(self._stream, chunk_size=chunk_bytes, compression=compression)
        self._writer.start(profile='ros2', library='motion_detect_ros')

    def write_raw(self, topic: str, msgtype: str, data: bytes, log_stamp_ns: int) -> None:
        """Add CDR bytes of a ``msgtype`` (``sensor_msgs/msg/Image``) to a topic, recorded at ``log_stamp_ns``."""
        self._writer.add_message(
            self._channel(topic, msgtype), log_time=log_stamp_ns, data=data, publish_time=log_stamp_ns,
            sequence=self.message_count)
        self._stream.flush()  # whole chunks reach the disk at once
        self.message_count += 1

    def write(self, topic: str, message: Any, log_stamp_ns: int) -> None:
        """Add a message made by ``sources.messages``."""
        self.write_raw(topic, message.__msgtype__, messages.serialize(message), log_stamp_ns)

    def write_image(
        self, image: ByteArray, stamp_ns: int, topic: str = '/image_raw', frame_id: str = CAMERA_FRAME,
    ) -> None:
        """Add (H, W) mono8 or (H, W, 3) bgr8 pixels as sensor_msgs/Image."""
        self.write(topic, messages.image(image, stamp_ns, frame_id), stamp_ns)

    def write_compressed(
        self, data: bytes, image_format: str, stamp_ns: int, topic: str = '/image_raw/compressed',
        frame_id: str = CAMERA_FRAME,
    ) -> None:
        """Add the bytes of a picture file as they are; image_format: ``jpeg`` or ``png``."""
        self.write(topic, messages.compressed_image(data, image_format, stamp_ns, frame_id), stamp_ns)

    def write_camera_info(
        self, camera: CameraModel, stamp_ns: int, topic: str = '/camera_info', frame_id: str = CAMERA_FRAME,
        projection: DoubleArray | None = None,
    ) -> None:
        """Add sensor_msgs/CameraInfo; projection as in ``messages.camera_info``."""
        self.write(topic, messages.camera_info(camera, stamp_ns, frame_id, projection), stamp_ns)

    def write_detections(
        self, records: RecordArray, stamp_ns: int, topic: str = '/detections', frame_id: str = CAMERA_FRAME,
    ) -> None:
        """Add records of ``DETECTION_DTYPE`` as sensor_msgs/PointCloud2, fields in the same order and layout."""
        self.write(topic, messages.point_cloud(records, stamp_ns, frame_id), stamp_ns)

    def finish_part(self) -> None:
        """Close the file properly under its part name."""
        if not self._stream.closed:
            self._finish()
            self._stream.close()

    def close(self) -> None:
        """Give the file its name, before its lock ends: who waits for that would empty it."""
        self._finish()
        self.part_path.replace(self.path)
        self._stream.close()

    def _finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()

    def _channel(self, topic: str, msgtype: str) -> int:
        """The channel of a topic, registered at its first message."""
        key = topic, msgtype
        if key not in self._channels:
            definition = messages.message_definition(msgtype).encode()
            schema = self._writer.register_schema(name=msgtype, encoding='ros2msg', data=definition)
            self._channels[key] = self._writer.register_channel(
                topic=topic, message_encoding='cdr', schema_id=schema, metadata={'offered_qos_profiles': ''})
        return self._channels[key]
