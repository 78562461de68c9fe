"""The command line: ``python -m motion_detect_ros <command>``.

Exit codes: 0 done, 1 nothing could be done, 2 wrong use or unreadable input (one line on stderr says what and what
would be right), 3 partial (damaged or interrupted; what was recovered is kept).
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from motion_detect_ros.allocator import tune_malloc
from motion_detect_ros.cli.interrupts import interrupt_once

# FFmpeg and OpenCV print to stderr what we say in one line; both read this when first loaded.
os.environ.setdefault('OPENCV_FFMPEG_LOGLEVEL', '-8')
os.environ.setdefault('OPENCV_LOG_LEVEL', 'SILENT')

WRONG_USE, PARTIAL = 2, 3
#: Commands that leave .part files where they are ended, and what they say then.
_WITH_PARTS, _KEPT = ('demo', 'convert', 'replay'), 'what was written so far is kept in the .part files'
_STDERR = 2

#: Command -> module that has ``add_arguments`` and ``run``, and what it does in a few words.
_COMMANDS = {
    'demo': ('cli.demo', 'the main job on a built-in flight, over real nodes'),
    'convert': ('cli.convert', 'data set, image folder or video to a bag (MCAP)'),
    'replay': ('cli.replay', 'recordings through the detector, offline'),
    'report': ('cli.report', 'a page to look at, of what a replay left behind'),
    'evaluate': ('cli.evaluate', 'detections against ground truth'),
    'tune': ('cli.tune', 'settings for recordings of one kind, judged on what was held out'),
    'inspect': ('cli.inspect', 'what a bag holds and what of it is damaged'),
    'selftest': ('cli.selftest', 'whether this machine and installation will do: transport, clock, kernels, a flight'),
    'bench': ('benchmarks.bench', 'time per stage, and from image to detections'),
}


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage text around it."""

    def error(self, message: str) -> NoReturn:
        """Exit with code 2."""
        self.exit(WRONG_USE, f'{self.prog}: error: {message} (--help shows the usage)\n')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, return its exit code."""
    _open_closed_streams()
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == 'strict':
        sys.stdout.reconfigure(errors='backslashreplace')  # as stderr: names may be what the locale cannot hold
    words = list(sys.argv[1:] if arguments is None else arguments)
    hangs_up = signal.getsignal(signal.SIGHUP) == signal.SIG_DFL  # not under nohup
    interrupt_once(signal.SIGTERM, *[signal.SIGHUP] * hangs_up)
    tune_malloc()
    # Imported here: evaluate and inspect must not wait for numba to load.
    from motion_detect_ros.core.errors import MotionDetectError
    from motion_detect_ros.sources.secrets import masked
    parser = OneLineParser(prog='motion_detect_ros', description='Moving-object detection from a moving camera.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, (module, text) in _COMMANDS.items():
        sub = commands.add_parser(name, help=text, description=text)
        if words[:1] == [name]:
            importlib.import_module(f'motion_detect_ros.{module}').add_arguments(sub)
    options = parser.parse_args(words)
    kept = _KEPT if options.command in _WITH_PARTS else ''
    try:
        module, _ = _COMMANDS[options.command]
        code = int(importlib.import_module(f'motion_detect_ros.{module}').run(options))
        sys.stdout.flush()
        return code
    except MotionDetectError as error:
        print(f'error: {masked(str(error))}', file=sys.stderr)
        return WRONG_USE
    except BrokenPipeError:  # the reader of our output (head, less) has gone
        _give_up_output()
        return 0
    except (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError, FileExistsError) as error:
        print(f'error: {error.filename}: {error.strerror}', file=sys.stderr)
        return WRONG_USE
    except OSError as error:  # no space left, device gone
        try:
            sys.stdout.flush()
        except OSError:
            _give_up_output()
        print('; '.join(filter(None, (f'error: {error}', kept))), file=sys.stderr)
        return PARTIAL
    except KeyboardInterrupt as interrupt:  # may say what is kept
        print('; '.join(filter(None, ('interrupted', str(interrupt) or kept))), file=sys.stderr)
        return PARTIAL


def _open_closed_streams() -> None:
    """Print into nothing where standard output or error is closed: else messages would go from one to the other, and
    files would get the numbers to which libraries in C print.
    """
    if sys.stdout is None or sys.stderr is None:
        while (free := os.open(os.devnull, os.O_RDWR)) <= _STDERR:
            pass
        os.close(free)
        sys.stdout, sys.stderr = (stream or os.fdopen(os.open(os.devnull, os.O_WRONLY), 'w')
                                  for stream in (sys.stdout, sys.stderr))


def _give_up_output() -> None:
    """Print into nothing from now on: what waits to be printed would fail again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == '__main__':
    sys.exit(main())
