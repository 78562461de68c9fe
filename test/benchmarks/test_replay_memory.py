"""The verdict on memory over a long replay, and what it is measured on."""

from __future__ import annotations

import argparse
import sys
import textwrap
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from motion_detect_ros.benchmarks import replay_memory
from motion_detect_ros.benchmarks.replay_memory import Sample, judge, replay_command, watch, write_recording
from motion_detect_ros.cli.replay import add_arguments
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.formats import FORMATS
from motion_detect_ros.sources.bags import BagFrames, BagReader
from motion_detect_ros.sources.messages import COMPRESSED_IMAGE, deserialize

FLAT = [Sample(2000 * (n + 1), (n + 1) / 18, 300.0) for n in range(36)]


def test_flat() -> None:
    verdict = judge(FLAT)
    assert (verdict.highest_mb, verdict.growth_mb, verdict.growth_mb_per_hour, verdict.flat) == (300.0, 0.0, 0.0, True)


def test_a_leak_is_seen_and_measured() -> None:
    """8 MB an hour, of which the last three quarters of two hours count."""
    verdict = judge([replace(sample, memory_mb=300.0 + 8.0 * sample.hours) for sample in FLAT])
    assert verdict.growth_mb_per_hour == pytest.approx(8.0, abs=0.01)
    assert verdict.growth_mb == pytest.approx(8.0 * 26 / 18, abs=0.1)
    assert not verdict.flat


def test_caches_that_fill_at_the_start_are_no_leak() -> None:
    assert judge([replace(sample, memory_mb=300.0 - max(0.0, 50.0 - sample.frames / 200)) for sample in FLAT]).flat


def test_too_large_is_not_flat() -> None:
    assert not judge([replace(sample, memory_mb=501.0) for sample in FLAT]).flat


def test_too_few_samples_say_nothing() -> None:
    with pytest.raises(SourceError, match='expected samples of 6000 frames and more, got 1 samples'):
        judge(FLAT[:1])


def test_the_recording_goes_to_and_fro_at_its_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = [SimpleNamespace(image=np.full((48, 64, 3), 60 * number, np.uint8)) for number in range(4)]
    monkeypatch.setattr(replay_memory, 'SyntheticFlight', lambda config: flight)
    write_recording(tmp_path / 'a.mcap', 10)
    with BagReader(tmp_path / 'a.mcap') as reader:
        pictures = [deserialize(message.data, COMPRESSED_IMAGE).data.tobytes() for message in reader.messages()]
    different = list(dict.fromkeys(pictures))
    assert [different.index(picture) for picture in pictures] == [0, 1, 2, 3, 2, 1, 0, 1, 2, 3]
    stamps = [frame.stamp_ns for frame in BagFrames(tmp_path / 'a.mcap')]
    assert [later - sooner for sooner, later in pairwise(stamps)] == [10**8] * 9


def test_a_process_is_sampled_as_its_file_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process waits for its reader: it adds ten lines only once the sample before is taken."""
    monkeypatch.setattr(replay_memory, 'LOOK_S', 0.01)
    code = textwrap.dedent('''
        import sys, time
        from pathlib import Path
        for number in range(3):
            with open(sys.argv[1], 'a') as file:
                file.write('line\\n' * 10)
            while not Path(f'{sys.argv[1]}.{number}').exists():
                time.sleep(0.01)
    ''')
    progress = tmp_path / 'frames.csv.part'
    samples = []
    for sample in watch([sys.executable, '-c', code, str(progress)], progress, 10):
        Path(f'{progress}.{len(samples)}').touch()
        samples.append(sample)
    assert [sample.frames for sample in samples] == [10, 20, 30]
    assert all(1.0 < sample.memory_mb < 500.0 for sample in samples)


def test_a_replay_that_fails_is_one_line(tmp_path: Path) -> None:
    code = 'import sys; sys.exit("error: no room")'
    with pytest.raises(SourceError, match='^replay: expected exit code 0, got 1: error: no room$'):
        list(watch([sys.executable, '-c', code], tmp_path / 'none'))


def test_the_command_is_one_that_replay_takes_and_writes_every_format(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = replay_command(tmp_path / 'a.mcap', tmp_path / 'out', ['--preset', 'visdrone'])
    given = parser.parse_args(words[words.index('replay') + 1:])
    assert (given.inputs, given.output, given.preset) == ([str(tmp_path / 'a.mcap')], tmp_path / 'out', 'visdrone')
    assert set(given.formats.split(',')) == set(FORMATS)


@pytest.mark.parametrize('words', [['--hours', '0'], ['--hours', 'nan']])
def test_wrong_use_is_one_line(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay_memory.main([*words, '-o', str(tmp_path)]) == 2
    assert capsys.readouterr().err == f'error: --hours: expected over 0, got {words[1]}\n'
