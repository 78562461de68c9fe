"""Two network namespaces and the radio link between them: it loses and delays Ethernet frames, and can be cut.

What tc netem does in kernels that have it: here a TAP device in each namespace, and a thread that carries frames.
"""

from __future__ import annotations

import contextlib
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

TUN = Path('/dev/net/tun')
_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
LONGEST_FRAME = 65536
POLL_S = 0.005


class LossyLink:
    """Use as a context manager. ``run(side)`` is the beginning of a command line that runs in namespace 0 or 1.

    loss: share of the frames in each direction; delay_s: of the others. Raises: OSError where the system refuses it.
    """

    def __init__(self, loss: float, delay_s: float) -> None:
        self._loss, self._delay_s = loss, delay_s
        self.cut = False
        self.carried = self.lost = 0
        self._random = random.Random(1)
        self._stack = contextlib.ExitStack()
        self._pids: list[int] = []
        self._ended = threading.Event()

    def __enter__(self) -> LossyLink:
        try:
            taps = [self._side(side) for side in range(2)]
        except BaseException:
            self._stack.close()
            raise
        carrier = threading.Thread(target=self._carry, args=(taps,), daemon=True)
        carrier.start()
        self._stack.callback(carrier.join)
        self._stack.callback(self._ended.set)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run(self, side: int) -> list[str]:
        """In front of a command."""
        return ['nsenter', '-t', str(self._pids[side]), '-n']

    def _side(self, side: int) -> int:
        """A namespace with its interface; the descriptor of that."""
        holder = subprocess.Popen(['unshare', '-n', 'sh', '-c', 'echo; exec sleep 3600'], stdout=subprocess.PIPE)
        self._stack.callback(_ended(holder))
        assert holder.stdout is not None
        if not holder.stdout.readline():
            raise OSError('unshare -n: refused')
        self._pids.append(holder.pid)
        descriptor, name = os.open(TUN, os.O_RDWR | os.O_NONBLOCK), f'md{os.getpid()}x{side}'
        self._stack.callback(os.close, descriptor)
        fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack('16sH', name.encode(), _IFF_TAP | _IFF_NO_PI))
        for words in (['ip', 'link', 'set', name, 'netns', str(holder.pid)],
                      [*self.run(side), 'ip', 'link', 'set', 'lo', 'up'],
                      [*self.run(side), 'ip', 'address', 'add', f'10.99.0.{side + 1}/24', 'dev', name],
                      [*self.run(side), 'ip', 'link', 'set', name, 'multicast', 'on', 'up'],
                      [*self.run(side), 'ip', 'route', 'add', '224.0.0.0/4', 'dev', name]):
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            if done.returncode:
                raise OSError(f'{" ".join(words)}: {done.stderr.strip()}')
        return descriptor

    def _carry(self, taps: list[int]) -> None:
        under_way: list[tuple[float, int, int, bytes]] = []
        while not self._ended.is_set():
            for tap in select.select(taps, [], [], POLL_S)[0]:
                with contextlib.suppress(BlockingIOError):
                    frame = os.read(tap, LONGEST_FRAME)
                    if self.cut or self._random.random() < self._loss:
                        self.lost += 1
                    else:
                        self.carried += 1
                        other = taps[1 - taps.index(tap)]
                        heapq.heappush(under_way, (time.monotonic() + self._delay_s, self.carried, other, frame))
            while under_way and under_way[0][0] <= time.monotonic():
                with contextlib.suppress(OSError):
                    os.write(under_way[0][2], under_way[0][3])
                heapq.heappop(under_way)


def _ended(process: subprocess.Popen[bytes]) -> Callable[[], None]:
    def end() -> None:
        process.kill()
        process.wait()

    return end


def refusal() -> str:
    """What the system says against such a link; empty where it can be made."""
    try:
        with LossyLink(0.0, 0.0):
            return ''
    except (OSError, AssertionError) as error:
        return str(error)
