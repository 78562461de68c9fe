"""Whether a video that gives no further frame has come to its end.

The number of frames does not tell: containers that do not count them (Matroska, WebM, MPEG) have it guessed by OpenCV
from their length, sound included, and those that do (MP4, AVI) count what an edit list or an empty chunk leaves out.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import cv2

MILLISECONDS = 1000.0
#: First bytes of a Matroska or WebM file, and of the one element that holds all of it after its header.
_EBML, _SEGMENT = b'\x1a\x45\xdf\xa3', b'\x18\x53\x80\x67'
#: First box of an MP4 or QuickTime file, after its length.
_BOXES = frozenset({b'ftyp', b'moov', b'mdat', b'wide', b'free', b'skip'})
#: Length of a RIFF file while it is written, and for ever where that goes to a pipe.
_UNKNOWN = b'\xff\xff\xff\xff'
#: Bytes that hold name and length of any of them.
_HEAD_BYTES = 16
#: First look beyond the last frame, seconds; the next ones are twice as far each.
_FIRST_LOOK_S = 0.5


def cut_off(path: Path) -> str | None:
    """In a few words where a file ends before its container does; None where it does not, or nobody knows.

    Formats: ISO/IEC 14496-12 (boxes), Microsoft's RIFF, RFC 8794 (EBML). Raises: OSError.
    """
    size = path.stat().st_size
    with path.open('rb') as file:
        expected = _length(file, size)
    return f'cut off after {size} of {expected} bytes' if expected > size else None


def more_follows(capture: cv2.VideoCapture, last_ms: float) -> bool:
    """Whether a video that could not be read beyond a frame, its time in ms, has later ones; moves the capture."""
    fps = capture.get(cv2.CAP_PROP_FPS)
    end_ms = capture.get(cv2.CAP_PROP_FRAME_COUNT) / fps * MILLISECONDS if fps > 0 else 0.0
    look_ms = _FIRST_LOOK_S * MILLISECONDS
    while True:
        capture.set(cv2.CAP_PROP_POS_MSEC, last_ms + look_ms)
        if capture.grab() and capture.get(cv2.CAP_PROP_POS_MSEC) > last_ms:
            return True
        look_ms *= 2.0
        if last_ms + look_ms >= end_ms:
            return False


def _length(file: BinaryIO, size: int) -> int:
    """Bytes that the container says it has, 0 = unknown."""
    head = _head(file, 0)
    if head.startswith(_EBML):
        place = _element_end(head, 0, len(_EBML))
        head = _head(file, place)
        return _element_end(head, place, len(_SEGMENT)) if head.startswith(_SEGMENT) else 0
    place = 0
    if head[4:8] in _BOXES:
        while place + 8 <= size and (length := _box_bytes(_head(file, place))):
            place += length
    while head.startswith(b'RIFF') and place + 8 <= size:
        if head[4:8] == _UNKNOWN:
            return 0
        place += 8 + int.from_bytes(head[4:8], 'little')
        head = _head(file, place)
    return place


def _head(file: BinaryIO, place: int) -> bytes:
    file.seek(place)
    return file.read(_HEAD_BYTES)


def _box_bytes(head: bytes) -> int:
    """Of an MP4 box, its length behind the name where that is 1; 0 where it goes to the end of the file, or is none."""
    length = int.from_bytes(head[:4], 'big')
    length = int.from_bytes(head[8:16], 'big') if length == 1 else length
    return length if length >= 8 and head[4:8].isalnum() else 0


def _element_end(head: bytes, place: int, name_bytes: int) -> int:
    """Where an EBML element ends; 0 where its length is unknown, as while it is recorded (all bits 1)."""
    first = head[name_bytes] if len(head) > name_bytes else 0
    length_bytes = 9 - first.bit_length()
    stop = name_bytes + length_bytes
    length = int.from_bytes(head[name_bytes:stop], 'big') - (1 << 7 * length_bytes)
    return 0 if not first or length == (1 << 7 * length_bytes) - 1 else place + stop + length
