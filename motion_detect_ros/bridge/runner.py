"""Runs one node as a process: clean start, clean end, one line and exit code 2 for wrong use."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from types import FrameType

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Future

from motion_detect_ros.allocator import tune_malloc
from motion_detect_ros.bridge.arguments import check_arguments, usage
from motion_detect_ros.bridge.exit_timer import exits_after, exits_in
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.params import warn_of_unknown_parameters
from motion_detect_ros.bridge.shared_memory import give_up_dead_ports, remove_dead_segments
from motion_detect_ros.core.errors import ConfigError, MotionDetectError
from motion_detect_ros.sources.secrets import masked

#: Longest round of the executor in which nothing happens, seconds.
ROUND_S = 0.5
#: Exit codes.
FAILED, FORCED, WRONG_USE = 1, 1, 2
#: Ending takes as long as blocked threads are waited for, about 10 s; over this it is given up, seconds.
ENDING_TIMEOUT_S = 15.0
#: How long telling the other nodes of the end may take. A node that is done ends all the same: they miss it by its
#: lease, 20 s later, seconds.
LEAVING_TIMEOUT_S = 5.0
#: Ctrl-C on ros2 launch sends two: the terminal's to the whole process group, and launch's own.
PATIENT_SIGNALS = 2
#: Functions (part of the module's path, name; empty = all) that no exception may leave, and when to try again where a
#: signal has found one, seconds: those that LLVM calls; what makes and ends the compiler's objects, as the end of half
#: of one is told on stderr; destructors, and what Python calls when an object or a module's lock goes.
UNBROKEN, RETRY_S = (
    ('/llvmlite/binding/executionengine.py', ''),
    *(('/llvmlite/binding/', name) for name in ('__init__', 'close', 'detach')),
    ('', '__del__'), ('/weakref.py', ''), ('/_weakrefset.py', ''),
    ('<frozen importlib._bootstrap>', 'cb')), 0.02


class Stopped(BaseException):
    """SIGINT or SIGTERM while a node is made or opened, which may take minutes."""


class StopRequest:
    """Notes SIGINT and SIGTERM; raises Stopped, once, where ``armed`` while a node is made or opened.

    rclpy handles the signal first and ends its context, which ends the spinning. A second one changes nothing, a third
    ends the process at once with code FORCED.
    """

    def __init__(self) -> None:
        self._count = 0
        self.node: ManagedNode | None = None
        self.armed = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)
        signal.signal(signal.SIGALRM, self._interrupt)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._count += 1
        if self._count > PATIENT_SIGNALS:
            os._exit(FORCED)
        self._interrupt(number, frame)

    def _interrupt(self, _number: int, frame: FrameType | None) -> None:
        if not self.armed or not (self.node is None or self.node.opening):
            return
        if _unbroken(frame):
            signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        else:
            self.armed = False
            raise Stopped

    def disarm(self) -> None:
        """Nothing is raised any more, and no timer is left, which would end a Python that has ended its handlers."""
        self.armed = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    @property
    def made(self) -> bool:
        """Whether there was a signal."""
        return self._count > 0


def _unbroken(frame: FrameType | None) -> bool:
    """Whether that frame or one above it is of ``UNBROKEN``: what is raised there is printed and lost."""
    while frame is not None:
        code = frame.f_code
        if any(part in code.co_filename and name in {'', code.co_name} for part, name in UNBROKEN):
            return True
        frame = frame.f_back
    return False


def run(make_node: Callable[[], ManagedNode]) -> int:
    """Spins the node until it is finished or told to stop; returns the process's exit code.

    0 after SIGINT or SIGTERM or a finished job or ``--help``, 2 with one line on stderr for wrong arguments, parameters
    or input, FAILED after another error, which is printed. Ends the process itself, with code FORCED at a third signal
    or where ending takes ENDING_TIMEOUT_S, with the code above where only leaving the network takes LEAVING_TIMEOUT_S.
    """
    tune_malloc()
    stop, code = StopRequest(), FAILED
    try:
        stop.armed = True
        code = _run(make_node, stop)
    except Stopped:
        code = 0
    except Exception:  # told before leaving, which may be for good
        traceback.print_exc()
    finally:
        stop.disarm()
        code = _finish(stop.node, code)
    return code


def _run(make_node: Callable[[], ManagedNode], stop: StopRequest) -> int:
    began = False
    try:
        if text := usage(sys.argv):
            print(text)
            return 0
        check_arguments(sys.argv)
        remove_dead_segments()
        give_up_dead_ports()
        rclpy.init()
        began = True
        if stop.made:
            return 0
        node = stop.node = make_node()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        node.start()
        spin(executor, node.finished)
        return node.exit_code
    except ExternalShutdownException:
        return 0
    except Exception as error:
        if stop.made or (began and not rclpy.ok()):  # a signal ends the context in a thread, maybe before it is noted
            return 0
        # Before there is a node, these are rclpy's words for wrong --ros-args and wrong values of its own parameters.
        if isinstance(error, MotionDetectError) or (
                isinstance(error, RuntimeError | ParameterException) and stop.node is None):
            return _complain(error)
        raise


def main_of(make_node: Callable[[], ManagedNode]) -> Callable[[], None]:
    """The console script of a node, whose process ends LEAVING_TIMEOUT_S after the node has left, at the latest."""
    def main() -> None:
        code = run(make_node)
        exits_in(LEAVING_TIMEOUT_S, code)  # threads of Fast DDS that are joined at the end may wait for themselves
        if any(thread.daemon for thread in threading.enumerate()):  # it would abort an interpreter that is going
            _flush()
            os._exit(code)
        sys.exit(code)
    return main


def spin(executor: SingleThreadedExecutor, finished: Future) -> None:
    """Work until ``finished``, and shut the executor down: else it and its guard, collected in any order, may complain.

    ``spin_until_future_complete`` of rclpy 7 leaves a callback on the future in every round: 5 kB a second at 20 Hz.
    """
    def wake(_: Future) -> None:
        with suppress(AttributeError):  # rclpy's for an executor that is shut down, where nobody is to be woken
            executor.create_task(lambda: None)

    finished.add_done_callback(wake)  # else the round waits for a message
    try:
        while executor.context.ok() and not finished.done():
            executor.spin_once(timeout_sec=ROUND_S)  # a signal that comes just before the wait does not end it
    finally:
        executor.shutdown()


def run_plain(make_node: Callable[[], Node]) -> None:
    """Spins a node without states until SIGINT or SIGTERM, for programs beside the package's nodes.

    With ``rclpy.spin`` the signal also raises KeyboardInterrupt, anywhere: in the midst of taking a message it comes
    out as RuntimeError. Here the signal ends the context only, and the executor returns when what it does is done.
    Ends the process itself where leaving takes LEAVING_TIMEOUT_S, and so long after the end of the program has begun.

    Names of parameters that neither it nor a node of the package knows are warned of. A program with arguments of its
    own takes them out of ``sys.argv`` before.

    Raises: SystemExit, with code 0 after ``--help``, WRONG_USE after one line on stderr for wrong arguments and
    parameters, FAILED after another error of the node, which is printed, before it was told to stop.
    """
    if text := usage(sys.argv):
        print(text)
        sys.exit(0)
    try:
        check_arguments(sys.argv)
    except ConfigError as error:
        sys.exit(_complain(error))
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    give_up_dead_ports()
    rclpy.init()
    node, code = None, FAILED
    try:
        node = make_node()
        warn_of_unknown_parameters(node)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        if not signals:  # one from before rclpy was there to see it has ended nothing
            spin(executor, Future())
        code = 0
    except Exception as error:
        if not rclpy.ok():
            code = 0
        elif node is None and isinstance(error, MotionDetectError | ParameterException):
            code = _complain(error)
        else:
            traceback.print_exc()
    finally:
        _leave(node, code)
        atexit.register(exits_in, LEAVING_TIMEOUT_S, code)
    if code:
        sys.exit(code)


def end_context() -> None:
    """End rclpy's context, whether or not its own thread for signals is doing so at the same moment."""
    try:
        rclpy.try_shutdown()
    except rclpy_implementation.RCLError:
        if rclpy.ok():
            raise


def _complain(error: Exception) -> int:
    print(' '.join(masked(str(error)).split()), file=sys.stderr)
    return WRONG_USE


def _finish(node: ManagedNode | None, code: int) -> int:
    """End and leave; returns ``code``, or FAILED after an error in the end, which is printed."""
    try:
        with exits_after(ENDING_TIMEOUT_S, FORCED):
            try:
                if node is not None:
                    node.close()
            except Exception:
                traceback.print_exc()
                code = FAILED
        _leave(node, code)
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):  # nothing is left to interrupt but Python's own end
            signal.signal(number, signal.SIG_IGN)
    return code


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # there may be none, or nobody who reads
            stream.flush()


def _leave(node: Node | None, code: int) -> None:
    """Take the node off the network; ends the process with ``code`` where that takes LEAVING_TIMEOUT_S."""
    _flush()
    with exits_after(LEAVING_TIMEOUT_S, code):
        if node is not None:
            node.destroy_node()
        end_context()
