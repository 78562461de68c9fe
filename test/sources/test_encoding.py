"""The pixel codec against layouts written out by hand, byte by byte."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.sources.encoding import ENCODINGS, ImageDecoder, decode, encoding_of, pixel_rows


def pixels(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 9),
       st.sampled_from([('u1', 'B'), ('u2', 'H'), ('f4', 'f')]), st.integers(1, 4), st.booleans(), st.booleans())
def test_any_layout_reads_as_unpacked_one_by_one(height, width, padding, kind, channels, big, cut_off_padding):
    dtype, code = kind
    form = f"{'>' if big else '<'}{width * channels}{code}"
    values = np.arange(height * width * channels).reshape(height, width * channels) % 200
    rows = [struct.pack(form, *row.tolist()) + b'\xee' * padding for row in values]
    data = b''.join(rows)
    data = data[:len(data) - padding] if cut_off_padding else data
    found = pixel_rows(height, width, dtype, channels, big, struct.calcsize(form) + padding, data)
    assert found.shape == ((height, width) if channels == 1 else (height, width, channels))
    np.testing.assert_array_equal(found.reshape(values.shape), values)


def test_padding_at_the_end_of_rows_is_cut_off():
    data = bytes([1, 2, 3, 99, 4, 5, 6, 99])
    assert decode(2, 3, 'mono8', False, 4, data).tolist() == [[1, 2, 3], [4, 5, 6]]
    assert decode(2, 3, 'mono8', False, 4, data[:-1]).tolist() == [[1, 2, 3], [4, 5, 6]]  # last padding left out


@pytest.mark.parametrize(('encoding', 'bytes_', 'bgr'), [
    ('bgr8', [10, 20, 30], [10, 20, 30]), ('rgb8', [10, 20, 30], [30, 20, 10]),
    ('bgra8', [10, 20, 30, 255], [10, 20, 30]), ('rgba8', [10, 20, 30, 255], [30, 20, 10]),
    ('8UC3', [10, 20, 30], [10, 20, 30]),
])
def test_colour_orders(encoding, bytes_, bgr):
    assert decode(1, 1, encoding, False, len(bytes_), bytes(bytes_)).tolist() == [[bgr]]


@pytest.mark.parametrize(('big', 'data'), [(False, [0x34, 0x12]), (True, [0x12, 0x34])])
def test_sixteen_bits_keep_their_upper_eight_in_both_byte_orders(big, data):
    assert decode(1, 1, 'mono16', big, 2, bytes(data)).tolist() == [[0x12]]


def scaled(samples: np.ndarray, bits: int) -> np.ndarray:
    """0 .. 2^bits - 1 as 0 .. 255: the nearest lower grey, by floating point."""
    return np.floor(samples / 2.0 ** bits * 256.0).astype(int)


def of_stream(decoder: ImageDecoder, samples: np.ndarray, encoding: str = 'mono16', big: bool = False) -> np.ndarray:
    data = samples.astype('>u2' if big else '<u2')
    return decoder.decode(*samples.shape[:2], encoding, big, data.strides[0], data.tobytes())


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('bits', [8, 10, 12, 14, 16])
def test_sensors_of_fewer_bits_keep_their_contrast(bits, big):
    samples = np.linspace(0, 2 ** bits - 1, 48).astype(int).reshape(6, 8)
    found = of_stream(ImageDecoder(), samples, big=big)
    np.testing.assert_array_equal(found, scaled(samples, bits))
    assert (found.min(), found.max()) == (0, 255)


def test_brightness_does_not_follow_the_picture_once_the_sensor_is_known():
    """12 bits: a bright picture, then the same ground without the lamp and in the dark."""
    decoder, ground = ImageDecoder(), np.arange(48).reshape(6, 8) * 40
    lamp = ground.copy()
    lamp[0, 0] = 4000
    for samples in (lamp, ground, ground // 40, np.zeros_like(ground), ground):
        np.testing.assert_array_equal(of_stream(decoder, samples), scaled(samples, 12))


def test_a_stream_in_the_dark_gets_darker_when_more_bits_are_seen_and_never_brighter_again():
    decoder, grey = ImageDecoder(), []
    for largest in (1000, 3000, 1000, 65535, 1000):
        grey.append(int(of_stream(decoder, np.array([[0, 1000, largest]]))[0, 1]))
    assert grey == [1000 // 4, 1000 // 16, 1000 // 16, 1000 // 256, 1000 // 256]


def test_colour_of_twelve_bits_and_what_is_over_the_range_given():
    samples = np.array([[[0x0123, 0x0456, 0x0fff]]])
    assert of_stream(ImageDecoder(), samples, 'rgb16').tolist() == [[[0xff, 0x45, 0x12]]]
    assert decode(1, 1, 'mono16', False, 2, struct.pack('<H', 0x1fff), bits=12).tolist() == [[255]]


@pytest.mark.parametrize(('encoding', 'order'), [('uyvy', (128, 200, 128, 50)), ('yuv422_yuy2', (200, 128, 50, 128))])
def test_yuv_pixels_share_their_colour(encoding, order):
    # U = V = 128 is no colour: both pixels are grey of their own brightness, (Y - 16) * 255 / 219
    found = decode(1, 2, encoding, False, 4, bytes(order))
    for pixel, luma in zip(found[0], (200, 50), strict=True):
        np.testing.assert_allclose(pixel, (luma - 16) * 255 / 219, atol=2)


@pytest.mark.parametrize(('encoding', 'red_at'), [
    ('bayer_rggb8', (0, 0)), ('bayer_bggr8', (1, 1)), ('bayer_grbg8', (0, 1)), ('bayer_gbrg8', (1, 0))])
def test_bayer_red_comes_out_red(encoding, red_at):
    mosaic = np.zeros((16, 16), np.uint8)
    mosaic[red_at[0]::2, red_at[1]::2] = 200
    blue, green, red = decode(16, 16, encoding, False, 16, mosaic.tobytes())[8, 8]
    assert red > 90 and blue == 0 and green < red


def test_contiguous_images_are_viewed_not_copied():
    buffer = bytearray(pixels((4, 6, 3)).tobytes())
    view = decode(4, 6, 'bgr8', False, 18, buffer)
    buffer[0] ^= 255
    assert view[0, 0, 0] == buffer[0]


@pytest.mark.parametrize(('arguments', 'words'), [
    ((2, 2, 'jpeg9000', False, 6, bytes(12)), "expected one of mono8, .*, got 'jpeg9000'"),
    ((2, 2, 'bgr8', False, 5, bytes(12)), 'step: expected at least 6 bytes for 2 pixels, got 5'),
    ((2, 2, 'bgr8', False, 6, bytes(11)), 'data: expected 12 bytes, got 11'),
    ((0, 2, 'bgr8', False, 6, b''), 'size: expected at least 1x1, got 2x0'),
    ((2, 3, 'uyvy', False, 6, bytes(12)), 'image of 3x2 pixels cannot be uyvy: expected an even width'),
    ((2, 3, 'yuyv', False, 6, bytes(12)), 'image of 3x2 pixels cannot be yuyv: expected an even width'),
])
def test_errors_say_expected_and_actual(arguments, words):
    with pytest.raises(MessageError, match=words):
        decode(*arguments)


def test_every_encoding_gives_bytes_of_the_image_size():
    for name, layout in ENCODINGS.items():
        step = 8 * layout.channels * np.dtype(layout.dtype).itemsize
        found = decode(6, 8, name, False, step, bytes(6 * step))
        assert found.shape[:2] == (6, 8) and found.dtype == np.uint8, name


def test_colour_of_sixteen_bits():
    data = struct.pack('>3H', 0x1100, 0x22ff, 0x3301)
    assert decode(1, 1, 'rgb16', True, 6, data).tolist() == [[[0x33, 0x22, 0x11]]]
    assert decode(1, 1, 'bgr16', True, 6, data).tolist() == [[[0x11, 0x22, 0x33]]]


def test_what_can_be_sent_is_named():
    assert (encoding_of(pixels((2, 3))), encoding_of(pixels((2, 3, 3)))) == ('mono8', 'bgr8')
    for image in (np.zeros((2, 3), np.float32), pixels((2, 3, 4)), pixels((6,))):
        with pytest.raises(MessageError, match=r'expected uint8 \(H, W\) or \(H, W, 3\), got'):
            encoding_of(image)
