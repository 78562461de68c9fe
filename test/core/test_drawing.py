"""Pictures for people: pixels where the geometry says, colours by the colour wheel."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.drawing import color_of, draw_boxes, draw_detections, flow_to_color, label_of
from motion_detect_ros.core.types import empty_detections


def detection(**values: float) -> np.ndarray:
    records = empty_detections(1)
    for name, value in {'u': 50, 'v': 40, 'width': 20, 'height': 10, 'id': 7, **values}.items():
        records[name] = value
    return records


def test_box_is_drawn_around_its_centre_in_the_colour_of_its_id():
    picture = draw_detections(np.zeros((80, 100, 3), np.uint8), detection())
    corners = [(35, 40), (35, 60), (45, 40), (45, 60)]  # row, column: 40 +- 5, 50 +- 10
    for row, column in corners:
        assert picture[row, column].any(), (row, column)
    np.testing.assert_array_equal(picture[35, 55], color_of(7))
    assert not picture[37:43, 43:48].any()      # inside
    assert not picture[48:, :].any()            # below
    assert not picture[:, 63:].any()            # right


@pytest.mark.parametrize(('identity', 'label'), [
    (7, '7'), (53544, '53544'), (284853544, '53544'), (284800012, '00012')])
def test_the_last_five_digits_of_an_id_are_shown(identity: int, label: str):
    """Zeros too: 12 would be the end of others."""
    assert label_of(identity) == label


def test_pictures_show_these_digits():
    black = np.zeros((80, 100, 3), np.uint8)
    text = [draw_detections(black, detection(id=identity))[20:33].any(axis=2) for identity in (284800012, 12, 84800012)]
    np.testing.assert_array_equal(text[0], text[2])
    assert text[0].sum() > text[1].sum() > 0


def test_arrow_shows_half_a_second_of_velocity():
    picture = draw_detections(np.zeros((200, 300, 3), np.uint8), detection(u=100, v=100, vel_u=240.0))
    assert picture[100, 215].any()               # tip at 100 + 120
    assert not picture[:, 225:].any()
    back = draw_detections(np.zeros((200, 300, 3), np.uint8), detection(u=150, v=100, vel_u=0.0, vel_v=-120.0))
    assert back[45, 150].any() and not back[:36, :].any()


def test_grey_becomes_colour_and_the_input_stays_as_it_was():
    for shape in ((80, 100), (80, 100, 3)):
        image = np.full(shape, 9, np.uint8)
        picture = draw_detections(image, detection())
        assert picture.shape == (80, 100, 3)
        assert (image == 9).all()
        np.testing.assert_array_equal(picture[0, 0], (9, 9, 9))


@pytest.mark.parametrize('values', [{'u': np.nan}, {'v': np.inf}, {'width': np.nan}, {'height': -np.inf}])
def test_boxes_that_are_no_boxes_are_left_out_and_the_next_is_drawn(values):
    records = np.concatenate([detection(**values), detection()])
    np.testing.assert_array_equal(draw_detections(np.zeros((80, 100, 3), np.uint8), records),
                                  draw_detections(np.zeros((80, 100, 3), np.uint8), detection()))


def test_absurd_numbers_do_not_stop_the_picture():
    black = np.zeros((80, 100, 3), np.uint8)
    unknown = draw_detections(black, detection(vel_u=np.nan))
    assert unknown[35, 55].any() and not unknown[37:43, 43:58].any()   # box, no arrow
    assert not draw_detections(black, detection(u=1e12)).any()
    far = draw_detections(black, detection(vel_u=1e30))
    assert far[40, 55:].any(axis=1).all()                              # the arrow leaves the picture


def test_colours_of_ids_are_stable_bright_and_apart():
    colors = [color_of(identity) for identity in range(1, 9)]
    assert colors == [color_of(identity) for identity in range(1, 9)]
    assert all(max(color) == 255 for color in colors)
    distances = [np.abs(np.subtract(a, b)).max() for i, a in enumerate(colors) for b in colors[:i]]
    assert min(distances) >= 60


def test_truth_boxes_are_thin_outlines():
    image = np.zeros((30, 40, 3), np.uint8)
    draw_boxes(image, np.array([[5, 6, 10, 8]], np.float32), (0, 255, 0))
    assert (image[6, 5:16] == (0, 255, 0)).all() and (image[6:15, 15] == (0, 255, 0)).all()
    assert not image[8:13, 7:14].any()
    draw_boxes(image, np.zeros((0, 4), np.float32), (0, 255, 0))


@pytest.mark.parametrize(('vector', 'bgr'), [
    ((3.0, 0.0), (0, 0, 255)),       # right: hue 0, red
    ((-3.0, 0.0), (255, 255, 0)),    # left: hue 180, cyan
    ((0.0, 3.0), (0, 255, 128)),     # down: hue 90
    ((0.0, -3.0), (255, 0, 128)),    # up: hue 270
])
def test_direction_of_flow_is_the_hue(vector, bgr):
    flow = np.tile(np.float32(vector), (4, 5, 1))
    np.testing.assert_allclose(flow_to_color(flow, 3.0)[1, 2].astype(int), bgr, atol=6)


def test_length_of_flow_is_the_brightness_up_to_the_given_full_scale():
    flow = np.zeros((1, 4, 2), np.float32)
    flow[0, :, 0] = [0.0, 2.0, 4.0, 8.0]
    assert flow_to_color(flow, 4.0).max(axis=2)[0].tolist() == pytest.approx([0, 127, 255, 255], abs=1)


def test_unknown_flow_is_grey_and_does_not_touch_the_scale():
    flow = np.ones((2, 2, 2), np.float32)
    flow[0, 0] = np.nan
    picture = flow_to_color(flow)
    grey = picture[0, 0]
    assert grey[0] == grey[1] == grey[2] and 50 <= grey[0] <= 200  # neither black, which is no flow, nor white
    assert picture[1, 1].max() == 255 and np.ptp(picture[1, 1]) == 255
    np.testing.assert_array_equal(flow_to_color(np.full((2, 2, 2), np.nan, np.float32)),
                                  np.broadcast_to(grey, (2, 2, 3)))
