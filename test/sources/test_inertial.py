"""Angular rates on their way to a stage: which picture gets which samples, by hand."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import BagFrames, BagWriter
from motion_detect_ros.sources.inertial import (
    LONGEST_PAUSE_NS,
    NEAR_NS,
    GyroQueue,
    GyroReplay,
    GyroSample,
    InertialSource,
)
from motion_detect_ros.sources.messages import IMU, header, make

MS = 1_000_000


def queue_of(*stamps_ms: int, offset_s: float = 0.0) -> GyroQueue:
    queue = GyroQueue(offset_s)
    for stamp in stamps_ms:
        queue.add(GyroSample(stamp * MS, (0.0, 0.0, float(stamp))))
    return queue


def taken(queue: GyroQueue, stamp_ms: int) -> list[int]:
    return [sample.stamp_ns // MS for sample in queue.take(stamp_ms * MS)]


def test_a_picture_gets_what_is_before_it_and_the_next_sample():
    queue = queue_of(0, 10, 20, 30, 40, 50)
    assert (taken(queue, 25), taken(queue, 30), taken(queue, 45)) == ([0, 10, 20, 30], [40], [50])


def test_a_sample_far_ahead_waits_for_its_own_picture():
    queue = queue_of(0, 100, 200)
    assert (taken(queue, 10), taken(queue, 90), taken(queue, 200)) == ([0], [100], [200])


@pytest.mark.parametrize(('offset_s', 'covered', 'got'), [(-0.02, 10, [0, 10, 20, 30]), (0.02, 50, [0])])
def test_an_offset_of_the_clocks_moves_the_samples(offset_s: float, covered: int, got: list[int]):
    """added to the stamps 0, 10, 20, 30 ms it gives -20 .. 10 and 20 .. 50 ms of the camera's clock."""
    queue = queue_of(0, 10, 20, 30, offset_s=offset_s)
    assert queue.covers(covered * MS)
    assert not queue.covers((covered + 1) * MS)
    assert taken(queue, 10) == got


def test_after_a_jump_back_the_earlier_run_is_forgotten():
    queue = queue_of(900, 910, 0, 10)
    assert taken(queue, 5) == [0, 10]


FUTURE = 10**9  # ms; eleven days


def test_a_stamp_from_the_future_costs_its_sample_only():
    """Live: what waits for the next picture stays."""
    queue = queue_of(0, 10, FUTURE, 20, 30)
    assert not queue.covers(40 * MS)
    assert taken(queue, 25) == [0, 10, 20, 30]


def replay_of(*stamps_ms: int) -> GyroReplay:
    return GyroReplay(iter([GyroSample(stamp * MS, (0.0, 0.0, 0.0)) for stamp in stamps_ms]))


def replayed(replay: GyroReplay, *pictures_ms: int) -> list[list[int]]:
    return [[sample.stamp_ns // MS for sample in replay.take(picture * MS)] for picture in pictures_ms]


@pytest.mark.parametrize('strays', [1, 2, 5])
@pytest.mark.parametrize('stray_ms', [FUTURE, 2000])
def test_wrong_stamps_of_samples_do_not_end_a_replay(strays: int, stray_ms: int):
    """A sample every 10 ms, a picture every 20 ms; after 50 ms some stamps are wrong."""
    stamps = [*range(0, 60, 10), *(stray_ms + number for number in range(strays)), *range(60, 400, 10)]
    got = replayed(replay_of(*stamps), *range(0, 400, 20))
    assert got[10:] == [[picture - 10, picture] for picture in range(200, 400, 20)]
    assert all(stamp < 400 for part in got for stamp in part)
    if strays == 1:
        assert [stamp for part in got for stamp in part] == [*range(0, 390, 10)], 'nothing but the stray is lost'


def test_a_pause_of_the_samples_is_no_wrong_stamp():
    stamps = [*range(0, 100, 10), *range(5000, 5100, 10)]
    got = replayed(replay_of(*stamps), *range(0, 5100, 20))
    assert [stamp for part in got for stamp in part] == stamps[:-1]


def test_a_wrong_stamp_of_a_picture_uses_up_no_samples():
    replay = replay_of(*range(0, 200, 10))
    assert replayed(replay, 0, 20, FUTURE, 40, 60)[1:] == [[0, 10, 20], [], [30, 40], [50, 60]]
    assert replayed(replay_of(*range(0, 200, 10)), FUTURE, 20, 40) == [[], [0, 10, 20], [30, 40]]


def test_after_a_long_pause_of_the_pictures_the_samples_go_on():
    pause_ms = LONGEST_PAUSE_NS // MS + 1000
    got = replayed(replay_of(*range(0, pause_ms + 200, 10)), 0, 20, pause_ms, pause_ms + 20, pause_ms + 40)
    assert got[2] == []
    assert (got[3][-2:], got[4]) == ([pause_ms + 10, pause_ms + 20], [pause_ms + 30, pause_ms + 40])


@given(st.lists(st.integers(0, 400), unique=True, min_size=1).map(sorted),
       st.lists(st.integers(0, 400), unique=True, min_size=1).map(sorted), st.data())
def test_late_and_early_arrival_give_the_same_samples(samples: list[int], pictures: list[int], data: st.DataObject):
    """All at once, or as live: any time before what covers a picture, at the latest when it is waited for."""
    at_once = queue_of(*samples)
    expected = [taken(at_once, picture) for picture in pictures]
    live, coming, found = GyroQueue(), list(samples), []
    for picture in pictures:
        least = next((index + 1 for index, stamp in enumerate(coming) if stamp >= picture), len(coming))
        for stamp in coming[:data.draw(st.integers(least, max(least, len(coming))))]:
            live.add(GyroSample(stamp * MS, (0.0, 0.0, 0.0)))
            coming.remove(stamp)
        found.append(taken(live, picture))
    assert found == expected
    for stamps, picture in zip(expected, pictures, strict=True):
        assert sum(stamp >= picture for stamp in stamps) <= 1
        assert all(stamp < picture + NEAR_NS // MS for stamp in stamps)


#: Half of it is longer than any machine takes for what needs no waiting.
LONG_S = 400.0


def test_late_samples_are_waited_for_but_not_where_none_come():
    queue = queue_of()
    start = time.monotonic()
    assert not queue.wait_for(5 * MS, LONG_S)  # none ever
    queue.add(GyroSample(0, (0.0, 0.0, 0.0)))
    threading.Timer(0.1, lambda: queue.add(GyroSample(6 * MS, (0.0, 0.0, 0.0)))).start()
    assert queue.wait_for(5 * MS, LONG_S)
    assert time.monotonic() - start < 0.5 * LONG_S
    assert not queue.wait_for(9 * MS, 0.2)
    start = time.monotonic()
    assert not queue.wait_for(99 * MS, LONG_S)  # nothing new since the last wait
    assert time.monotonic() - start < 0.5 * LONG_S


def imu(stamp_ms: int, *rate: float) -> object:
    return make(IMU, header=header(stamp_ms * MS, 'imu'),
                angular_velocity=make('geometry_msgs/msg/Vector3', **dict(zip('xyz', rate, strict=True))))


def bag(folder: Path, *topics: str) -> BagFrames:
    with BagWriter(folder / 'flight.mcap') as writer:
        writer.write_image(np.zeros((48, 64), np.uint8), 5 * MS)
        for index, topic in enumerate(topics):
            writer.write(topic, imu(3, 1.0, 2.0, 3.0 + index), 4 * MS)
            writer.write(topic, imu(9, 4.0, 5.0, 6.0 + index), 10 * MS)
        writer.write_raw('/imu', IMU, b'\0\1\0\0rubbish', 11 * MS)
    return BagFrames(folder / 'flight.mcap')


def test_bags_give_the_rates_with_the_stamps_of_their_headers(tmp_path: Path):
    frames = bag(tmp_path, '/imu')
    assert isinstance(frames, InertialSource)
    assert list(frames.gyro()) == [GyroSample(3 * MS, (1.0, 2.0, 3.0)), GyroSample(9 * MS, (4.0, 5.0, 6.0))]
    assert len(list(frames)) == 1


def test_messages_of_a_bag_that_say_they_have_no_rate_are_left_out(tmp_path: Path):
    """sensor_msgs/Imu: without an estimate of an element, the first element of its covariance is -1."""
    with BagWriter(tmp_path / 'flight.mcap') as writer:
        writer.write_image(np.zeros((48, 64), np.uint8), 5 * MS)
        for index, (of_rate, of_attitude) in enumerate([(-1.0, 0.0), (0.0, -1.0), (0.01, 0.0), (-1.0, -1.0)]):
            message = imu(index, 1.0, 2.0, 3.0)
            message.angular_velocity_covariance[0], message.orientation_covariance[0] = of_rate, of_attitude
            writer.write('/imu', message, index * MS)
    assert [sample.stamp_ns // MS for sample in BagFrames(tmp_path / 'flight.mcap').gyro()] == [1, 2]


def test_the_topic_named_imu_is_meant(tmp_path: Path):
    assert [sample.rate[2] for sample in bag(tmp_path, '/other/imu', '/imu').gyro()] == [4.0, 7.0]


def test_several_others_are_listed(tmp_path: Path):
    with BagWriter(tmp_path / 'flight.mcap') as writer:
        writer.write_image(np.zeros((48, 64), np.uint8), 5 * MS)
        writer.write('/a/imu', imu(3, 0.0, 0.0, 0.0), 4 * MS)
        writer.write('/b/imu', imu(3, 0.0, 0.0, 0.0), 4 * MS)
    with pytest.raises(SourceError, match=r'expected one topic of type Imu .*, got /a/imu \(1\), /b/imu \(1\)'):
        BagFrames(tmp_path / 'flight.mcap').gyro()
