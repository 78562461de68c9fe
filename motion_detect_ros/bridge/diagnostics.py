"""The health of a node, published once a second."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from motion_detect_ros.core.self_tuning import Tuned
from motion_detect_ros.core.types import EgoMotion

#: Latest frames that rates and latencies are taken over.
WINDOW = 200
#: Silence after which frames no longer flow, seconds, and in periods of a slow source.
SILENT_S = 1.0
SILENT_PERIODS = 3.0
#: How long an error, or an image that was left out, is worth a warning, seconds.
RECENT_S = 3.0
#: Images come, but none could be used for so long: a warning, an error, seconds.
BLIND_WARN_S, BLIND_ERROR_S = 2.0, 5.0
#: Key of how many subscriptions a publisher of the node has found, with the topic's name behind it.
SUBSCRIBERS_OF = 'subscribers of '
#: Keys of what a node has counted since its start.
COUNTERS = 'received', 'processed', 'left_out', 'dropped', 'errors'


@dataclass(frozen=True)
class Summary:
    """Counters of a stage: totals, and rates (Hz) and latencies (ms) over the last frames.

    ``left_out``: on purpose, by decimation; ``dropped``: for other reasons. ``period_s``: median time between inputs,
    NaN before the second. ``silent_s``, ``error_age_s``: since the latest input and the latest error; infinite where
    there was none.
    """

    received: int
    processed: int
    left_out: int
    dropped: int
    errors: int
    rate_in_hz: float
    rate_out_hz: float
    latency_p50_ms: float
    latency_p95_ms: float
    stamp_age_ms: float
    period_s: float
    silent_s: float
    error_age_s: float
    last_error: str
    unused_s: float = 0.0
    unused_reason: str = ''


@dataclass(frozen=True)
class Condition:
    """What a node knows about itself beyond its counters, each a few words or empty.

    ``fault``: it cannot do its work (ERROR); ``concern``: it does it badly (WARN); ``idle``: nothing is to be done
    now, so that silence and drops mean nothing (OK); ``waits``: what inputs wait for, which is no matter for a moment;
    ``unheard``: why nothing may come, said where nothing comes.
    """

    fault: str = ''
    concern: str = ''
    idle: str = ''
    waits: str = ''
    unheard: str = ''


class StageStats:
    """Counters that executor and worker threads may both touch. All times are of ``time.monotonic_ns``."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._processed = self._left_out = self._dropped = self._errors = 0
        self._last_error = ''
        self._error_ns: int | None = None
        self._arrivals: deque[int] = deque(maxlen=WINDOW)
        self._departures: deque[int] = deque(maxlen=WINDOW)
        self._latencies_ms: deque[float] = deque(maxlen=WINDOW)
        self._stamp_age_ms = float('nan')
        self._unused_since_ns: int | None = None
        self._expected_ns = 0
        self._unused_reason = ''

    def expect_use(self, now_ns: int) -> None:
        """An input has arrived that is to be used; ``count_used`` answers it."""
        with self._lock:
            silent_s = (now_ns - self._expected_ns) / 1e9
            if self._unused_since_ns is None or silent_s > _silence_limit_s(self._period_s()):
                self._unused_since_ns, self._unused_reason = now_ns, ''
            self._expected_ns = now_ns

    def count_used(self) -> None:
        """An input could be used for what the stage is there for."""
        with self._lock:
            self._unused_since_ns, self._unused_reason = None, ''

    def count_unused(self, reason: str) -> None:
        """An input could not be used, though it was processed or left out in good order."""
        with self._lock:
            self._unused_reason = reason

    def expect_nothing(self) -> None:
        """What has come so far is no longer to be used."""
        self.count_used()

    def count_received(self, now_ns: int) -> None:
        """An input has arrived."""
        with self._lock:
            self._received += 1
            self._arrivals.append(now_ns)

    def count_processed(self, now_ns: int, latency_ms: float, stamp_age_ms: float) -> None:
        """An output has left; latency: compute time, stamp_age: now - stamp of the image, milliseconds."""
        with self._lock:
            self._processed += 1
            self._departures.append(now_ns)
            self._latencies_ms.append(latency_ms)
            self._stamp_age_ms = stamp_age_ms

    def count_left_out(self, count: int = 1) -> None:
        """Inputs were left out on purpose: nothing is wrong."""
        with self._lock:
            self._left_out += count

    def count_dropped(self, count: int = 1) -> None:
        """Inputs were left out that could have been used, or that cannot."""
        with self._lock:
            self._dropped += count

    def count_error(self, message: str, now_ns: int | None = None) -> None:
        """An input could not be used; now_ns: by default now."""
        with self._lock:
            self._errors += 1
            self._last_error, self._error_ns = message, time.monotonic_ns() if now_ns is None else now_ns
            self._unused_reason = message

    def summary(self, now_ns: int) -> Summary:
        """A consistent copy of everything."""
        with self._lock:
            latencies = np.array(self._latencies_ms) if self._latencies_ms else np.array([np.nan])
            p50, p95 = np.percentile(latencies, [50, 95])
            return Summary(
                self._received, self._processed, self._left_out, self._dropped, self._errors,
                _rate(self._arrivals, now_ns), _rate(self._departures, now_ns), float(p50), float(p95),
                self._stamp_age_ms, self._period_s(),
                _seconds_since(self._arrivals[-1] if self._arrivals else None, now_ns),
                _seconds_since(self._error_ns, now_ns), self._last_error,
                0.0 if self._unused_since_ns is None else _seconds_since(self._unused_since_ns, now_ns),
                self._unused_reason)

    def _period_s(self) -> float:
        return float(np.median(np.diff(self._arrivals))) / 1e9 if len(self._arrivals) > 1 else math.nan


def _seconds_since(then_ns: int | None, now_ns: int) -> float:
    return math.inf if then_ns is None else (now_ns - then_ns) / 1e9


def _rate(times_ns: deque[int], now_ns: int) -> float:
    """Events a second up to now; falls to zero when nothing comes any more."""
    if len(times_ns) < 2 or now_ns <= times_ns[0]:
        return 0.0
    return (len(times_ns) - 1) * 1e9 / (now_ns - times_ns[0])


class Reporter:
    """Turns the counters of a node into messages; drops count since the last one.

    Any thread may report: each dropped frame is in the message of exactly one report.
    """

    def __init__(self, name: str, hardware_id: str, stats: StageStats) -> None:
        self._name, self._hardware_id, self._stats = name, hardware_id, stats
        self._lock = threading.Lock()
        self._dropped = 0
        self._level = DiagnosticStatus.ERROR  # before the first report there is none to be worse than

    def worse(self, now_ns: int, condition: Condition) -> bool:
        """Whether a report made now would be of a higher level than the last one."""
        with self._lock:
            summary = self._stats.summary(now_ns)
            return _judged(summary, condition, summary.dropped - self._dropped)[0] > self._level

    def report(
        self, now_ns: int, condition: Condition, stamp: Time, extra: tuple[tuple[str, str], ...] = (),
    ) -> DiagnosticArray:
        """One status with every figure as a key-value pair. now_ns: of ``time.monotonic_ns``.

        ERROR for a fault, and where images come but for BLIND_ERROR_S none could be used; WARN for that for
        BLIND_WARN_S, for recent errors, for frames dropped since the last report, a concern and silence; OK otherwise,
        and where the node is idle.
        """
        with self._lock:  # a summary taken outside could be older than that of the last report
            summary = self._stats.summary(now_ns)
            dropped, self._dropped = summary.dropped - self._dropped, summary.dropped
            level, message = _judged(summary, condition, dropped)
            self._level = level
        values = [KeyValue(key=key, value=value) for key, value in (*_pairs(summary), *extra)]
        status = DiagnosticStatus(
            level=level, name=self._name, message=message, hardware_id=self._hardware_id, values=values)
        return DiagnosticArray(header=Header(stamp=stamp), status=[status])


def tuned_pairs(tuned: Tuned) -> tuple[tuple[str, str], ...]:
    """The settings in use that may follow the scene (``self_tuning``), as key-value pairs."""
    return (('noise_floor_px', f'{tuned.noise_floor_px:.3f}'), ('initial_neurons', str(tuned.initial_neurons)),
            ('max_neurons', str(tuned.max_neurons)))


def silent(summary: Summary) -> str:
    """In a few words how long nothing has come; empty while inputs flow at their usual pace."""
    if summary.received == 0:
        return 'nothing received yet'
    is_silent = summary.silent_s > _silence_limit_s(summary.period_s)
    return f'nothing received for {summary.silent_s:.0f} s' if is_silent else ''


def _silence_limit_s(period_s: float) -> float:
    """period_s: usual time between inputs, NaN = unknown."""
    return max(SILENT_S, SILENT_PERIODS * period_s) if math.isfinite(period_s) else SILENT_S


def _blind(summary: Summary, waits: str, longer_than_s: float) -> str:
    """In a few words since when and why images come in vain; empty where it is not so long, or none come."""
    if summary.unused_s <= longer_than_s or silent(summary):
        return ''
    reason = summary.unused_reason or waits or 'none is finished'
    return f'no image could be used for {summary.unused_s:.0f} s: {reason}'


def _judged(summary: Summary, condition: Condition, dropped: int) -> tuple[bytes, str]:
    if condition.fault:
        return DiagnosticStatus.ERROR, condition.fault
    if blind := '' if condition.idle else _blind(summary, condition.waits, BLIND_ERROR_S):
        return DiagnosticStatus.ERROR, blind
    if summary.error_age_s <= RECENT_S:
        return DiagnosticStatus.WARN, f'{summary.errors} errors, last: {summary.last_error}'
    if condition.idle:
        return DiagnosticStatus.OK, condition.idle
    lost = f'{dropped} dropped since the last report' if dropped else ''
    blind = _blind(summary, condition.waits, BLIND_WARN_S)
    silence = silent(summary)
    unheard = condition.unheard if silence or blind else ''
    trouble = ', '.join(filter(None, (lost, condition.concern, silence, unheard, blind)))
    if trouble:
        return DiagnosticStatus.WARN, trouble
    return DiagnosticStatus.OK, f'{summary.rate_out_hz:.1f} Hz'


def _pairs(summary: Summary) -> tuple[tuple[str, str], ...]:
    return tuple(
        (key, f'{value:.3f}' if isinstance(value, float) else str(value)) for key, value in vars(summary).items())


def unused_for(ego: EgoMotion, has_reference: bool = True) -> str:
    """Why an image cannot be searched for moving objects; empty where it can."""
    if not ego.ok:
        return f'ego-motion is {ego.status.name}'
    return '' if has_reference else 'there is no earlier image to compare with'
