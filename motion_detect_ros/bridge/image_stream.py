"""How well the images of a topic arrive: stamps, losses on the way."""

from __future__ import annotations

from motion_detect_ros.bridge.diagnostics import RECENT_S
from motion_detect_ros.bridge.gaps import GapWatch
from motion_detect_ros.core.stamp_order import Verdict
from motion_detect_ros.core.types import NANOSECONDS

#: A larger share of images that never arrive is worth a warning.
LOST_SHARE = 0.2
#: What a verdict means to who looks for the fault.
TROUBLES = {
    Verdict.SEEN: 'images with a stamp that was seen already are left out',
    Verdict.LATE: 'images that come after later ones are left out',
    Verdict.NEGATIVE: 'images with a stamp before 1970 are left out',
    Verdict.BEYOND: 'images with a stamp beyond 2038 are left out',
    Verdict.MISSING: 'images carry no stamp (all zero) and are left out: expected a driver that stamps, or the node '
                     'pipeline with stamp_missing:=arrival',
}
ARRIVAL_USED = 'images carry no stamp (all zero), their time of arrival is used'
CURES = {
    'raw': 'set image_transport:=compressed, or use a reliable publisher and image_reliability:=reliable, with the '
           'Fast DDS profile on both sides (README, Transport)',
    'compressed': 'use a reliable publisher and image_reliability:=reliable',
}


class ImageStream:
    """Keeps what the diagnostics say about the images of one topic; all times are of ``time.monotonic_ns``."""

    def __init__(self, compressed: bool) -> None:
        self._cure = CURES['compressed' if compressed else 'raw']
        self._gaps = GapWatch()
        self._trouble, self._trouble_ns = '', 0

    def add(self, verdict: Verdict, stamp_ns: int, now_ns: int, *, stamped: bool) -> None:
        """An image has come and was judged. stamped: by its camera, not by us."""
        if not stamped:
            self._trouble, self._trouble_ns = ARRIVAL_USED, now_ns
        elif verdict in TROUBLES:
            self._trouble, self._trouble_ns = TROUBLES[verdict], now_ns
        if stamped and verdict.usable:
            self._gaps.add(stamp_ns)

    def trouble(self, now_ns: int) -> str:
        """What is wrong with the stamps of late, in a few words, or empty."""
        return self._trouble if now_ns - self._trouble_ns <= RECENT_S * NANOSECONDS else ''

    def loss(self) -> str:
        """In a few words how many images do not arrive and what helps; empty where most do."""
        losses = self._gaps.losses()
        if losses is None or losses.share <= LOST_SHARE:
            return ''
        return (f'{losses.share:.0%} of the images do not arrive (published at {losses.published_hz:.1f} Hz by their '
                f'stamps): {self._cure}')

    def values(self) -> tuple[tuple[str, str], ...]:
        """Key-value pairs for ``/diagnostics``."""
        losses = self._gaps.losses()
        published_hz, share = (losses.published_hz, losses.share) if losses else (float('nan'), float('nan'))
        return ('published_hz', f'{published_hz:.3f}'), ('lost_share', f'{share:.3f}')
