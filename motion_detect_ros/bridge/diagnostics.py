"""What a node tells about itself once a second."""

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

#: Latest frames that rates and latencies are taken over.
WINDOW = 200
#: Silence after which frames no longer flow, and how long an error is worth a warning, seconds.
SILENT_S = 2.0
RECENT_S = 10.0


@dataclass(frozen=True)
class Summary:
    """Counters of a stage: totals, and rates (Hz) and latencies (ms) over the last frames.

    ``silent_s``, ``error_age_s``: since the latest input and the latest error; infinite where there was none.
    """

    received: int
    processed: int
    dropped: int
    errors: int
    rate_in_hz: float
    rate_out_hz: float
    latency_p50_ms: float
    latency_p95_ms: float
    stamp_age_ms: float
    silent_s: float
    error_age_s: float
    last_error: str


class StageStats:
    """Counters that executor and worker threads may both touch. All times are of ``time.monotonic_ns``."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._processed = self._dropped = self._errors = 0
        self._last_error = ''
        self._error_ns: int | None = None
        self._arrivals: deque[int] = deque(maxlen=WINDOW)
        self._departures: deque[int] = deque(maxlen=WINDOW)
        self._latencies_ms: deque[float] = deque(maxlen=WINDOW)
        self._stamp_age_ms = float('nan')

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

    def count_dropped(self, count: int = 1) -> None:
        """Inputs were left out."""
        with self._lock:
            self._dropped += count

    def count_error(self, message: str, now_ns: int | None = None) -> None:
        """An input could not be used; now_ns: by default now."""
        with self._lock:
            self._errors += 1
            self._last_error, self._error_ns = message, time.monotonic_ns() if now_ns is None else now_ns

    def summary(self, now_ns: int) -> Summary:
        """A consistent copy of everything."""
        with self._lock:
            latencies = np.array(self._latencies_ms) if self._latencies_ms else np.array([np.nan])
            p50, p95 = np.percentile(latencies, [50, 95])
            return Summary(
                self._received, self._processed, self._dropped, self._errors, _rate(self._arrivals, now_ns),
                _rate(self._departures, now_ns), float(p50), float(p95), self._stamp_age_ms,
                _seconds_since(self._arrivals[-1] if self._arrivals else None, now_ns),
                _seconds_since(self._error_ns, now_ns), self._last_error)


def _seconds_since(then_ns: int | None, now_ns: int) -> float:
    return math.inf if then_ns is None else (now_ns - then_ns) / 1e9


def _rate(times_ns: deque[int], now_ns: int) -> float:
    """Events a second up to now; falls to zero when nothing comes any more."""
    if len(times_ns) < 2 or now_ns <= times_ns[0]:
        return 0.0
    return (len(times_ns) - 1) * 1e9 / (now_ns - times_ns[0])


def to_diagnostics(
    name: str, hardware_id: str, summary: Summary, stamp: Time, extra: tuple[tuple[str, str], ...] = (),
) -> DiagnosticArray:
    """One status: OK while frames flow, WARN for recent errors and for silence, details as key-value pairs."""
    level, message = _judged(summary)
    values = [KeyValue(key=key, value=value) for key, value in (*_pairs(summary), *extra)]
    status = DiagnosticStatus(level=level, name=name, message=message, hardware_id=hardware_id, values=values)
    return DiagnosticArray(header=Header(stamp=stamp), status=[status])


def _judged(summary: Summary) -> tuple[bytes, str]:
    if summary.error_age_s <= RECENT_S:
        return DiagnosticStatus.WARN, f'{summary.errors} errors, last: {summary.last_error}'
    if summary.received == 0:
        return DiagnosticStatus.WARN, 'nothing received yet'
    if summary.silent_s > SILENT_S:
        return DiagnosticStatus.WARN, f'nothing received for {summary.silent_s:.0f} s'
    return DiagnosticStatus.OK, f'{summary.rate_out_hz:.1f} Hz'


def _pairs(summary: Summary) -> tuple[tuple[str, str], ...]:
    return tuple(
        (key, f'{value:.3f}' if isinstance(value, float) else str(value)) for key, value in vars(summary).items())
