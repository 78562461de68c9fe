"""``inspect``: what a bag holds, how regular it is, and what of a damaged one can be recovered."""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from motion_detect_ros.core.types import NANOSECONDS, DoubleArray
from motion_detect_ros.sources.bags import BagReader
from motion_detect_ros.sources.raw import LOST, printable
from motion_detect_ros.sources.timeline import timeline

#: An interval this many times the median one is a gap.
GAP_FACTOR = 2.5

OK, PARTIAL = 0, 3


@dataclass(frozen=True)
class TopicReport:
    """One topic: ``count`` readable messages of ``announced``, median ``rate_hz``, ``gaps``, the longest interval."""

    name: str
    msgtype: str
    count: int
    announced: int
    rate_hz: float
    gaps: int
    longest_gap_s: float


@dataclass(frozen=True)
class BagReport:
    """A whole bag, read from front to back. ``clock_jumps`` are no time that passed, as for the player."""

    path: str
    duration_s: float
    clock_jumps: int
    damaged: str | None
    topics: tuple[TopicReport, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('bag', type=Path, help='MCAP file, db3 file or bag folder')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(arguments: argparse.Namespace) -> int:
    """Print the report; exit code 3 for a damaged bag. Raises: SourceError where it is no bag."""
    report = inspect_bag(arguments.bag)
    print(json.dumps(asdict(report)) if arguments.json else _as_table(report))
    return PARTIAL if report.damaged else OK


def inspect_bag(path: Path) -> BagReport:
    """Read every message of a bag. Raises: SourceError where it is no bag."""
    stamps: defaultdict[tuple[str, ...], list[int]] = defaultdict(list)
    jumps = 0
    with BagReader(path) as bag:
        for timed in timeline(bag.messages()):
            message, jumps = timed.message, jumps + bool(timed.jump_ns)
            if message.data != LOST:
                late_ns = 0 if timed.jump_ns else timed.clock_ns - message.log_stamp_ns
                stamps[message.topic, message.msgtype, message.encoding].append(timed.position_ns - late_ns)
        topics = tuple(_topic_report(t.name, t.form, t.count, stamps[t.name, t.msgtype, t.encoding])
                       for t in bag.topics)
        damaged = bag.damaged
    everything = [stamp for times in stamps.values() for stamp in times]
    duration_ns = max(everything) - min(everything) if everything else 0
    return BagReport(str(path), duration_ns / NANOSECONDS, jumps, damaged, topics)


def _topic_report(name: str, msgtype: str, announced: int, stamps_ns: list[int]) -> TopicReport:
    steps_ns = [later - earlier for earlier, later in pairwise(sorted(stamps_ns))]  # of times up to 2**64
    intervals: DoubleArray = np.array(steps_ns, np.float64) / NANOSECONDS
    step_s = float(np.median(intervals)) if len(intervals) else 0.0
    rate_hz = 1 / step_s if step_s else 0.0
    if not step_s and intervals.any():  # times of a clock that ticks more slowly than messages come
        step_s, rate_hz = float(np.median(intervals[intervals > 0.0])), len(intervals) / float(intervals.sum())
    return TopicReport(name, msgtype, len(stamps_ns), announced, rate_hz,
                       int(np.sum(intervals > GAP_FACTOR * step_s)), float(intervals.max(initial=0.0)))


def _as_table(report: BagReport) -> str:
    total = sum(topic.count for topic in report.topics)
    jumps = f'its clock jumps {report.clock_jumps} times, which is no time that passed'
    lines = [f'{report.path}: {total} readable messages, {report.duration_s:.3f} s',
             f'damaged: {report.damaged}' if report.damaged else 'intact', *([jumps] if report.clock_jumps else []),
             f'{"topic":32s} {"type":34s} {"messages":>9s} {"rate Hz":>8s} {"gaps":>5s} {"longest s":>9s}']
    lines += [f'{printable(t.name):32s} {printable(t.msgtype):34s} {_count(t):>9s} {t.rate_hz:8.2f} {t.gaps:5d} '
              f'{t.longest_gap_s:9.3f}' for t in report.topics]
    return '\n'.join(lines)


def _count(topic: TopicReport) -> str:
    return str(topic.count) if topic.count == topic.announced else f'{topic.count}/{topic.announced}'
