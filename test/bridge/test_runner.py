"""The loop that every node runs in, and its end."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.task import Future

from motion_detect_ros.bridge.runner import end_context, spin
from motion_detect_ros.cli.domains import own_domain

pytestmark = pytest.mark.messages

TICKS = 200


def test_spinning_leaves_nothing_behind_and_ends_at_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context, finished, left = Context(), Future(), []
    rclpy.init(context=context, domain_id=own_domain())
    node, executor = rclpy.create_node('busy', context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def tick() -> None:
        left.append(len(finished._callbacks))
        if len(left) == TICKS:
            node.destroy_timer(timer)  # nothing else wakes the executor from now on
            threading.Timer(0.2, finished.set_result, (None,)).start()

    timer = node.create_timer(0.001, tick)
    spin(executor, finished)
    executor.shutdown(timeout_sec=2.0)
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert (len(left), max(left)) == (TICKS, 1)


def test_an_executor_that_has_spun_goes_quietly(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]):
    """The collector may take its guard for signals first; and a node that finishes later has nobody to wake."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context, finished = Context(), Future()
    rclpy.init(context=context, domain_id=own_domain())
    executor = SingleThreadedExecutor(context=context)
    guard = executor._sigint_gc
    threading.Timer(0.2, rclpy.shutdown, kwargs={'context': context}).start()
    with contextlib.suppress(ExternalShutdownException):
        spin(executor, finished)
    guard.__del__()
    executor.__del__()
    finished.set_result(None)
    assert capfd.readouterr().err == ''


#: A node whose thread is in and out of OpenCV, which gives the interpreter away, until some time after it is told to
#: stop. It prints what it is at.
BUSY_NODE = '''
import sys, time
import cv2, numpy as np
from motion_detect_ros.bridge import runner
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.worker import Worker

STAYS_S, HANGS_S, runner.ENDING_TIMEOUT_S = map(float, sys.argv[1:4])
del sys.argv[1:4]

class Busy(ManagedNode):
    def begin(self):
        self.told_s = None
        self.worker = Worker(self.work, 1, print)
        self.worker.submit(0)
        print('ready', flush=True)

    def work(self, _):
        image = np.zeros((200, 200), np.float32)
        while self.told_s is None or time.monotonic() < self.told_s + STAYS_S:
            cv2.blur(image, (15, 15))

    def end(self):
        self.told_s = time.monotonic()
        print('ending', flush=True)
        time.sleep(HANGS_S)
        self.worker.stop(timeout_s=1.0)

runner.main_of(lambda: Busy('busy'))()
'''
RUNS, AT_ONCE = 20, 5
SHORT_S = 0.02
SEED = 11


#: Words for a node that is to print nothing of its own accord.
QUIET = ('--ros-args', '--log-level', 'warn')


def started(script: str, *words: str, **variables: str) -> subprocess.Popen[str]:
    """A Python process in a domain of its own. variables: of its environment."""
    return subprocess.Popen(
        [sys.executable, '-c', script, *words], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, 'ROS_DOMAIN_ID': str(own_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
             **variables})


def busy_node(stays_s: float = 0.3, hangs_s: float = 0.0, timeout_s: float = 30.0) -> subprocess.Popen[str]:
    """``stays_s``: how long the thread goes on after it was told to stop; ``hangs_s``: how long stopping takes."""
    return started(BUSY_NODE, str(stays_s), str(hangs_s), str(timeout_s), *QUIET)


def await_line(process: subprocess.Popen[str], line: str) -> None:
    if not next((each for each in process.stdout if each == f'{line}\n'), None):
        pytest.fail(f'no line {line}: {end_of(process)}')


def end_of(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and what was printed on stderr; ends the process where it does not end."""
    try:
        _, errors = process.communicate(timeout=60.0)
    finally:
        process.kill()
    return process.returncode, errors


@pytest.mark.timeout(120)
def test_two_signals_end_a_node_as_one_does():
    """What a terminal and ros2 launch send on Ctrl-C: to the whole process group, and then again."""
    chance = random.Random(SEED)
    ends = []
    for _ in range(RUNS // AT_ONCE):
        processes = [busy_node() for _ in range(AT_ONCE)]
        for process in processes:
            await_line(process, 'ready')
            process.send_signal(signal.SIGINT)
            time.sleep(chance.uniform(0.0, SHORT_S))
            process.send_signal(signal.SIGINT)
        ends += [end_of(process) for process in processes]
    assert ends == [(0, '')] * RUNS


#: What a signal does while the main thread has not come to its handler yet: the context ends in the midst of a round.
ENDED_NODE = '''
import rclpy
from motion_detect_ros.bridge import runner
from motion_detect_ros.bridge.managed_node import ManagedNode

class Ended(ManagedNode):
    def begin(self):
        self.create_timer(0.01, self.tick)

    def tick(self):
        rclpy.try_shutdown()
        self.create_guard_condition(lambda: None)

runner.main_of(lambda: Ended('ended'))()
'''


def test_a_context_that_ends_before_the_signal_is_noted_ends_the_node_cleanly():
    assert end_of(started(ENDED_NODE, *QUIET)) == (0, '')


@pytest.mark.timeout(120)
def test_a_second_signal_does_not_interrupt_the_end():
    process = busy_node()
    await_line(process, 'ready')
    process.send_signal(signal.SIGINT)
    await_line(process, 'ending')
    process.send_signal(signal.SIGTERM)
    assert end_of(process) == (0, '')


@pytest.mark.timeout(120)
def test_a_third_signal_forces_the_end():
    process = busy_node(hangs_s=50.0)
    await_line(process, 'ready')
    process.send_signal(signal.SIGINT)
    await_line(process, 'ending')
    for number in (signal.SIGTERM, signal.SIGINT):  # two of a kind that wait would be one
        process.send_signal(number)
    assert end_of(process) == (1, '')


@pytest.mark.timeout(120)
def test_an_end_that_takes_too_long_is_forced():
    process = busy_node(hangs_s=50.0, timeout_s=0.5)
    await_line(process, 'ready')
    process.send_signal(signal.SIGINT)
    assert end_of(process) == (1, '')


@pytest.mark.timeout(120)
def test_a_thread_that_does_not_come_back_does_not_abort_the_process():
    """Longer than its worker is waited for."""
    process = busy_node(stays_s=3.0)
    await_line(process, 'ready')
    process.send_signal(signal.SIGINT)
    assert end_of(process) == (0, '')


#: A plain node that gets SIGINT in the midst of taking a message: rclpy makes it a RuntimeError there.
PLAIN_NODE = '''
import signal
from rclpy.node import Node
from std_msgs.msg import String
from motion_detect_ros.bridge.runner import run_plain

make = String.__init__

def interrupted(self, **fields):
    make(self, **fields)
    if not fields:
        print('taking', flush=True)
        signal.raise_signal(signal.SIGINT)

String.__init__ = interrupted

class Plain(Node):
    def __init__(self):
        super().__init__('plain')
        self.out = self.create_publisher(String, 'word', 1)
        self.create_timer(0.05, lambda: self.out.publish(String(data='sent')))
        self.create_subscription(String, 'word', print, 1)

run_plain(Plain)
print('ended', flush=True)
'''


@pytest.mark.timeout(120)
def test_a_plain_node_ends_cleanly_wherever_the_signal_finds_it():
    process = started(PLAIN_NODE)
    await_line(process, 'taking')
    await_line(process, 'ended')
    assert end_of(process) == (0, '')


#: Nodes that do not get off the network, in a call that keeps the interpreter to itself, as one of Fast DDS may.
STUCK_NODES = {
    'plain': """
import ctypes
from rclpy.node import Node
from motion_detect_ros.bridge.runner import run_plain

class Stuck(Node):
    def __init__(self):
        super().__init__('stuck')
        self.create_timer(0.0, lambda: (print('ready', flush=True), self.timer.cancel()))

    @property
    def timer(self):
        return next(iter(self.timers))

    def destroy_node(self):
        print('done', flush=True)
        ctypes.PyDLL(None).sleep(600)

run_plain(Stuck)
""",
    'managed': """
import ctypes
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.runner import main_of

class Stuck(ManagedNode):
    def begin(self):
        print('ready', flush=True)

    def end(self):
        print('done')

    def destroy_node(self):
        ctypes.PyDLL(None).sleep(600)

main_of(lambda: Stuck('stuck'))()
"""}


@pytest.mark.timeout(120)
@pytest.mark.parametrize('kind', STUCK_NODES)
def test_a_node_that_is_done_ends_well_where_it_cannot_leave(kind):
    process = started(STUCK_NODES[kind], *QUIET, PYTHONUNBUFFERED='')  # what is printed must be flushed by then
    await_line(process, 'ready')
    process.send_signal(signal.SIGINT)
    await_line(process, 'done')
    assert end_of(process) == (0, '')


#: Programs whose end hangs after the node has left: Python's own exit, and what the C library runs after it, where the
#: threads of Fast DDS are joined.
HANGING_ENDS = {
    'of Python': 'atexit.register(lambda: ctypes.PyDLL(None).sleep(600))',
    'of C': 'ctypes.CDLL(None).on_exit(ctypes.CDLL(None).pause, None)'}
ENDING_NODES = {
    'plain': """
from rclpy.node import Node
from motion_detect_ros.bridge.runner import run_plain

class Leaving(Node):
    def __init__(self):
        super().__init__('leaving')
        self.create_timer(0.1, rclpy.try_shutdown)

run_plain(Leaving)
print('after', flush=True)
""",
    'managed': """
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.runner import main_of

class Leaving(ManagedNode):
    def begin(self):
        self.create_timer(0.1, rclpy.try_shutdown)

main_of(lambda: Leaving('leaving'))()
"""}


@pytest.mark.timeout(120)
@pytest.mark.parametrize('kind', ENDING_NODES)
@pytest.mark.parametrize('end', HANGING_ENDS)
def test_a_process_ends_where_its_own_end_hangs(kind, end):
    process = started(f'import atexit, ctypes, rclpy\n{HANGING_ENDS[end]}\n{ENDING_NODES[kind]}', *QUIET)
    if kind == 'plain':
        await_line(process, 'after')
    assert end_of(process) == (0, '')


#: A node that cannot end, in a process whose own end hangs.
FAILING_NODE = f"""
import ctypes, rclpy
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.runner import main_of
{HANGING_ENDS['of C']}

class Failing(ManagedNode):
    def begin(self):
        self.create_timer(0.1, rclpy.try_shutdown)

    def end(self):
        raise ValueError('no end')

main_of(lambda: Failing('failing'))()
"""


@pytest.mark.timeout(120)
def test_an_error_while_a_node_ends_is_told_and_the_process_ends_all_the_same():
    code, errors = end_of(started(FAILING_NODE, *QUIET))
    assert code == 1
    assert errors.count('ValueError: no end') == 1


@pytest.mark.timeout(120)
def test_a_plain_node_stops_at_a_signal_from_before_rclpy_looks():
    script = ('import signal, rclpy\nfrom rclpy.node import Node\n'
              'from motion_detect_ros.bridge.runner import run_plain\n'
              'init = rclpy.init\nrclpy.init = lambda: (signal.raise_signal(signal.SIGTERM), init())\n'
              'run_plain(lambda: Node("early"))')
    assert end_of(started(script)) == (0, '')


@pytest.mark.timeout(120)
def test_a_plain_node_s_own_error_is_told():
    script = 'from motion_detect_ros.bridge.runner import run_plain\nrun_plain(lambda: 1 / 0)'
    code, errors = end_of(started(script))
    assert code == 1
    assert 'ZeroDivisionError' in errors


#: A node that takes long to make, and gets SIGTERM while the compiler calls back, as it does for every kernel.
COMPILING_NODE = """
import ctypes, signal, sys, time
from motion_detect_ros.bridge import runner

called = {}
source = 'def notify():\\n    signal.raise_signal(signal.SIGTERM)\\n    for _ in range(1000): pass\\n'
exec(compile(source, '/lib/llvmlite/binding/executionengine.py', 'exec'), {'signal': signal}, called)

def make():
    ctypes.CFUNCTYPE(None)(called['notify'])()
    print('compiled on', flush=True)
    time.sleep(60.0)

runner.main_of(make)()
"""


#: The same while a module's lock goes, whose callback Python's import has.
IMPORTING_NODE = """
import importlib._bootstrap as bootstrap, os, signal, sys, time
from motion_detect_ros.bridge import runner

def signal_in_callback(frame, event, _):
    if frame.f_code.co_name == 'cb' and frame.f_code.co_filename == '<frozen importlib._bootstrap>':
        sys.setprofile(None)
        signal.raise_signal(signal.SIGTERM)
        for _ in range(1000): pass

def make():
    lock = bootstrap._get_module_lock('a_module')
    sys.setprofile(signal_in_callback)
    del lock
    sys.setprofile(None)
    print('compiled on', flush=True)
    time.sleep(60.0)

runner.main_of(make)()
"""


#: The same while one of the compiler's objects is made: half of one that goes then is told on stderr. Its class has an
#: ``__init__`` of its own, in another module than that of all such objects.
MAKING_NODE = """
import signal, sys, time
from llvmlite.binding.context import get_global_context
from motion_detect_ros.bridge import runner

def signal_in_init(frame, event, _):
    if frame.f_code.co_name == '__init__' and frame.f_code.co_filename.endswith('llvmlite/binding/MODULE'):
        sys.setprofile(None)
        signal.raise_signal(signal.SIGTERM)
        for _ in range(1000): pass

def make():
    sys.setprofile(signal_in_init)
    made = get_global_context()
    sys.setprofile(None)
    print('compiled on', flush=True)
    time.sleep(60.0)

runner.main_of(make)()
"""
WHERE = {'compiler': COMPILING_NODE, 'import': IMPORTING_NODE,
         'object': MAKING_NODE.replace('MODULE', 'ffi.py'), 'its class': MAKING_NODE.replace('MODULE', 'context.py')}


@pytest.mark.timeout(120)
@pytest.mark.parametrize('script', WHERE.values(), ids=WHERE)
def test_a_signal_that_finds_what_must_not_break_counts_after_it(script: str):
    start_s = time.monotonic()
    process = started(script)
    await_line(process, 'compiled on')
    assert end_of(process) == (0, '')
    assert time.monotonic() - start_s < 50.0, 'not only after the whole time'


def test_a_context_that_a_signal_ends_at_the_same_moment_is_ended(monkeypatch: pytest.MonkeyPatch):
    """rclpy looks whether it is ended, and ends it: in between its own thread for signals may."""
    def late(self: Context) -> None:
        for _ in range(2):
            self.handle.shutdown()

    rclpy.init(domain_id=own_domain())
    with monkeypatch.context() as patch:
        patch.setattr(Context, 'try_shutdown', late)
        end_context()
    assert not rclpy.ok()
    rclpy.try_shutdown()  # forgets the ended one


#: A signal comes where nothing may be raised, and Python ends before it could be tried again.
LATE_ALARM = """
import signal, sys
from motion_detect_ros.bridge import runner
runner.RETRY_S = 0.5

class Thing:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

class Slow:
    def __del__(self, sleep=__import__('time').sleep):
        sleep(1.0)

def make_node():
    Thing()
    raise ValueError('told to stop meanwhile')

sys.modules['slow'] = Slow()  # goes when the handlers of Python have gone
sys.exit(runner.run(make_node))
"""


def test_no_timer_of_the_program_outlives_its_handlers():
    assert end_of(started(LATE_ALARM)) == (0, '')
