"""Runs one node as a process: clean start, clean end, one line and exit code 2 for wrong use."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.transport import tune_malloc
from motion_detect_ros.core.errors import MotionDetectError

WRONG_USE = 2


def run(make_node: Callable[[], ManagedNode]) -> int:
    """Spins the node until it is finished or told to stop; returns the process's exit code.

    0 after SIGINT or SIGTERM or a finished job, 2 with one line on stderr for wrong parameters or input.
    """
    tune_malloc()
    node: ManagedNode | None = None
    try:
        rclpy.init()
        node = make_node()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        node.start()
        executor.spin_until_future_complete(node.finished)
        return node.exit_code
    except MotionDetectError as error:
        return _complain(error)
    except rclpy.exceptions.ROSInterruptException:
        return 0
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except RuntimeError as error:  # rclpy: wrong --ros-args before there is a node, a broken context after a signal
        if node is None:
            return _complain(error)
        if rclpy.ok():
            raise
        return 0
    finally:
        _finish(node)


def main_of(make_node: Callable[[], ManagedNode]) -> Callable[[], None]:
    """The console script of a node."""
    def main() -> None:
        sys.exit(run(make_node))
    return main


def _complain(error: Exception) -> int:
    print(' '.join(str(error).split()), file=sys.stderr)
    return WRONG_USE


def _finish(node: ManagedNode | None) -> None:
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        if node is not None:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()
