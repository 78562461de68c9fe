"""sensor_msgs <-> numpy. The pixel codec itself is ``sources.encoding``."""

from __future__ import annotations

from array import array

import cv2
import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.core.types import NANOSECONDS, CameraModel, FlowField
from motion_detect_ros.sources.camera_info import distortion_model_of
from motion_detect_ros.sources.encoding import FLOW_ENCODING, ImageDecoder, encoding_of, pixel_rows
from motion_detect_ros.sources.images import PictureSizeError, decode_image
from motion_detect_ros.sources.messages import split_stamp

#: Of libjpeg, pixels a side.
LARGEST_JPEG_PX = 65500


def stamp_ns(header: Header) -> int:
    """Time of a header, nanoseconds."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def stamp_of(nanoseconds: int) -> Time:
    """Nanoseconds as a message. Raises: MessageError for what it cannot hold."""
    seconds, rest = split_stamp(nanoseconds)
    return Time(sec=seconds, nanosec=rest)


def header_of(nanoseconds: int, frame_id: str) -> Header:
    """A header with this time and frame. Raises: MessageError for a time that it cannot hold."""
    return Header(stamp=stamp_of(nanoseconds), frame_id=frame_id)


def image_from_msg(msg: Image | CompressedImage, decoder: ImageDecoder | None = None) -> npt.NDArray[np.uint8]:
    """(H, W) grey or (H, W, 3) BGR uint8; a view of the message's bytes where its layout allows.

    decoder: of the topic, which learns the depth of 16-bit images from those before; None = this is the only one.
    Raises: MessageError for an unknown encoding, too few bytes, or bytes that are no whole JPEG or PNG.
    """
    decoder = decoder or ImageDecoder()
    if isinstance(msg, CompressedImage):
        return _decompressed(msg, decoder)
    return decoder.decode(msg.height, msg.width, msg.encoding, bool(msg.is_bigendian), msg.step, msg.data)


def image_to_msg(image: npt.NDArray[np.uint8], header: Header) -> Image:
    """mono8 or bgr8. image: (H, W) or (H, W, 3) uint8. Raises: MessageError for anything else."""
    encoding = encoding_of(image)
    height, width = image.shape[:2]
    channels = 1 if image.ndim == 2 else image.shape[2]
    return Image(header=header, height=height, width=width, encoding=encoding, is_bigendian=0,
                 step=width * channels, data=bytes_of(image))


def compressed_to_msg(image: npt.NDArray[np.uint8], header: Header) -> CompressedImage:
    """JPEG. image: (H, W) or (H, W, 3) uint8, up to LARGEST_JPEG_PX. Raises: MessageError for anything else."""
    encoding = encoding_of(image)
    height, width = image.shape[:2]
    if max(height, width) > LARGEST_JPEG_PX:
        raise MessageError(f'JPEG: expected up to {LARGEST_JPEG_PX} pixels a side, got {width}x{height}')
    done, buffer = cv2.imencode('.jpg', image)
    if not done:
        raise MessageError(f'JPEG: OpenCV cannot encode {encoding} of {width}x{height} pixels')
    return CompressedImage(header=header, format=f'{encoding}; jpeg compressed {encoding}', data=bytes_of(buffer))


def flow_to_msg(flow: FlowField, header: Header) -> Image:
    """32FC2, channel 0 = dx, 1 = dy, full-resolution pixels, on the flow's own grid."""
    height, width = flow.flow.shape[:2]
    values = np.ascontiguousarray(flow.flow, '<f4')
    return Image(header=header, height=height, width=width, encoding=FLOW_ENCODING, is_bigendian=0,
                 step=width * 8, data=bytes_of(values))


def flow_from_msg(msg: Image) -> FlowField:
    """The flow field; its width and height are the grid's, as the message does not tell the image's.

    Raises: MessageError for another encoding.
    """
    if msg.encoding != FLOW_ENCODING:
        raise MessageError(f'flow encoding: expected {FLOW_ENCODING}, got {msg.encoding!r}')
    values = pixel_rows(msg.height, msg.width, 'f4', 2, bool(msg.is_bigendian), msg.step, msg.data)
    return FlowField(values.astype(np.float32), int(msg.width), int(msg.height), stamp_ns(msg.header))


def camera_to_msg(camera: CameraModel | None, width: int, height: int, header: Header) -> CameraInfo:
    """Calibration, of images of its own size; None: of ``width`` x ``height``, zeros say uncalibrated (REP 104)."""
    info = CameraInfo(header=header, height=height, width=width, distortion_model='plumb_bob', d=[0.0] * 5)
    if camera is not None:
        info.height, info.width = camera.height or height, camera.width or width
        if camera.distortion:
            info.d, info.distortion_model = list(camera.distortion), distortion_model_of(camera)
        fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
        info.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
        info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        info.p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


def bytes_of(values: npt.NDArray[np.generic]) -> array[int]:
    """The bytes of an array in the one form that rclpy's setters take without walking every element.

    values: of any shape and number type, copied in row order.
    """
    data = array('B')
    data.frombytes(np.ascontiguousarray(values).data.cast('B'))
    return data


def _decompressed(msg: CompressedImage, decoder: ImageDecoder) -> npt.NDArray[np.uint8]:
    try:
        return decode_image(bytes(msg.data), 'compressed image', decoder)
    except PictureSizeError as error:
        raise MessageError(str(error)) from None
    except SourceError as error:
        raise MessageError(f'{error}: expected JPEG or PNG, got format {msg.format!r}') from None
