"""What a soak run with faults says: memory, threads, handles, latency and processor time, late against early."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.benchmarks.feeder import Answer

#: Of the run, and seconds at least, until it is settled; the window after that is compared with one as long at the end.
SETTLED_SHARE, SETTLED_S = 1.0 / 6.0, 60.0
#: Room for all three: a shorter run says nothing.
LEAST_MINUTES = 3.0 * SETTLED_S / 60.0
#: Limits: resident memory, MB in ten minutes; 95th percentile of the latency and processor time, late over early.
SLOPE_MB, RATIO = 1.0, 1.2


@dataclass(frozen=True)
class ProcessSample:
    """One process at one moment. ``seconds``: since the start; ``cpu_s``: used since its own start."""

    seconds: float
    node: str
    memory_mb: float
    threads: int
    handles: int
    cpu_s: float


@dataclass(frozen=True)
class Fault:
    """What was done when, and how long it took until a picture sent after it was answered, seconds."""

    name: str
    at_s: float
    recovery_s: float


@dataclass(frozen=True)
class ProcessVerdict:
    """Settled part of one process: resident memory, MB, and its slope, MB in 10 minutes; medians early and late."""

    node: str
    memory_mb: float
    slope_mb: float
    threads: tuple[float, float]
    handles: tuple[float, float]
    cpu_s: tuple[float, float]

    @property
    def steady(self) -> bool:
        """Neither memory nor threads nor handles grow."""
        return self.slope_mb < SLOPE_MB and self.threads[1] <= self.threads[0] and self.handles[1] <= self.handles[0]


@dataclass(frozen=True)
class Verdict:
    """``p95_ms``, ``cpu_ms``: latency, and processor time of all stages for an answered picture, early and late;
    ``load``: mean load average of the machine early and late; ``recovery_s``: longest for each kind of fault.
    """

    minutes: float
    graph: str
    rate_hz: float
    sent: int
    answered: int
    p95_ms: tuple[float, float]
    cpu_ms: tuple[float, float]
    load: tuple[float, float]
    processes: tuple[ProcessVerdict, ...]
    recovery_s: dict[str, float]
    faults: int

    @property
    def steady(self) -> bool:
        """No process grows, and pictures cost no more processor time late than early."""
        return bool(self.answered) and all(one.steady for one in self.processes) and (
            self.cpu_ms[1] <= RATIO * self.cpu_ms[0])

    @property
    def in_time(self) -> bool:
        """The latency does not grow: means something where nobody else uses the machine."""
        return self.p95_ms[1] <= RATIO * self.p95_ms[0]


def settled_s(run_s: float) -> float:
    """When a run of so many seconds is settled; also the length of the windows, seconds."""
    return max(SETTLED_S, SETTLED_SHARE * run_s)


def judge(
    minutes: float, graph: str, rate_hz: float, sent: int, answers: Sequence[Answer], samples: Sequence[ProcessSample],
    faults: Sequence[Fault], loads: Sequence[float],
) -> Verdict:
    """answers: ``sent_s`` counts from the start."""
    end_s = 60.0 * minutes
    window_s = settled_s(end_s)
    early, late = (window_s, 2.0 * window_s), (end_s - window_s, end_s)
    nodes = dict.fromkeys(sample.node for sample in samples)
    processes = tuple(_process([one for one in samples if one.node == node], early, late) for node in nodes)
    counts = [sum(_within(answer.sent_s, window) for answer in answers) for window in (early, late)]
    cpu_s = [sum(one.cpu_s[index] for one in processes if one.node != 'camera') for index in range(2)]
    share = round(window_s / max(window_s, end_s) * len(loads))
    longest: dict[str, float] = {}
    for fault in faults:
        kind = 'kill' if fault.name.startswith('kill') else fault.name
        longest[kind] = round(max(longest.get(kind, 0.0), fault.recovery_s), 2)
    return Verdict(
        minutes, graph, rate_hz, sent, len(answers),
        (_p95(answers, early), _p95(answers, late)),
        (round(1e3 * cpu_s[0] / max(counts[0], 1), 1), round(1e3 * cpu_s[1] / max(counts[1], 1), 1)),
        (_mean(loads[share:2 * share]), _mean(loads[len(loads) - share:])), processes, longest, len(faults))


def _process(
    samples: Sequence[ProcessSample], early: tuple[float, float], late: tuple[float, float],
) -> ProcessVerdict:
    settled = [one for one in samples if one.seconds >= early[0]]
    first, last = ([one for one in settled if _within(one.seconds, window)] for window in (early, late))
    slope = 600.0 * float(np.polyfit([one.seconds for one in settled], [one.memory_mb for one in settled], 1)[0]) \
        if len(settled) > 1 else math.nan
    return ProcessVerdict(
        samples[0].node, settled[-1].memory_mb if settled else math.nan, round(slope, 2),
        (_median([one.threads for one in first]), _median([one.threads for one in last])),
        (_median([one.handles for one in first]), _median([one.handles for one in last])),
        (_cpu_s(first), _cpu_s(last)))


def _within(seconds: float, window: tuple[float, float]) -> bool:
    return window[0] <= seconds < window[1]


def _cpu_s(samples: Sequence[ProcessSample]) -> float:
    """Processor time in a whole window, from the samples within it."""
    if len(samples) < 2:
        return math.nan
    span_s = samples[-1].seconds - samples[0].seconds
    return round((samples[-1].cpu_s - samples[0].cpu_s) * len(samples) / (len(samples) - 1), 2) if span_s else math.nan


def _p95(answers: Sequence[Answer], window: tuple[float, float]) -> float:
    latencies = [answer.latency_ms for answer in answers if _within(answer.sent_s, window)]
    return round(float(np.percentile(latencies, 95)), 1) if latencies else math.nan


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan


def _mean(values: Sequence[float]) -> float:
    return round(float(np.mean(values)), 2) if values else math.nan
