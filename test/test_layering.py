"""The layers of the package: who may import whom, and how long anything may be.

    core <- sources <- bridge <- nodes
      ^--------^----------^----- cli <- benchmarks
               ^-- results <------^
                      ^-- report, tuning

and, within ``core``, which room may import which: a frame goes through them in the order of ``ROOMS``.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = 'motion_detect_ros'
ROOT = Path(__file__).resolve().parent.parent / PACKAGE
LAYERS = ('core', 'sources', 'results', 'report', 'tuning', 'bridge', 'nodes', 'cli', 'benchmarks')
#: The rooms of the core, each allowed to import itself and those before it; '' is what stands outside of any room.
ROOMS = ('geometry', 'preprocessing', 'flow_methods', 'ego_motion', 'optical_flow', 'background', 'clustering',
         'detection', 'trajectories', 'tracking')
#: Modules of the core outside of rooms that every room may import; all others put rooms together.
FOUNDATION = ('errors', 'types', 'settings', 'config', 'regions', 'forgetting', 'periods', 'self_tuning',
              'kernels', 'deferred', 'threads')

MAX_MODULE_LINES, MAX_NODE_LINES, MAX_FUNCTION_LINES = 300, 150, 60

#: What each layer must not import, as regular expressions on the full dotted name.
MESSAGES = r'\w+_msgs|std_srvs|builtin_interfaces|rcl_interfaces|unique_identifier_msgs'
ROS = rf'rclpy|rosidl\w*|ament_\w+|launch|launch_ros|rpyutils|{MESSAGES}'
FORBIDDEN = {
    '': rf'rosidl\w*|lark|cv_bridge|{MESSAGES}',
    'core': rf'{ROS}|{PACKAGE}\.(?!core\b).*',
    'sources': rf'{ROS}|{PACKAGE}\.(?!core\b|sources\b).*',
    'results': rf'{ROS}|{PACKAGE}\.(?!core\b|sources\b|results\b).*',
    'report': rf'{ROS}|{PACKAGE}\.(?!core\b|sources\b|results\b|report\b).*',
    'tuning': rf'{ROS}|{PACKAGE}\.(?!core\b|sources\b|results\b|tuning\b).*',
    'bridge': rf'rosidl\w*|lark|cv_bridge|{PACKAGE}\.(results|report|tuning|nodes|cli|benchmarks)',
    'nodes': rf'cv2|numba|scipy|rosidl\w*|cv_bridge|{MESSAGES}|{PACKAGE}\.(results|report|tuning|cli|benchmarks)',
    'cli': rf'rosidl\w*|lark|cv_bridge|{MESSAGES}|{PACKAGE}\.(nodes|benchmarks)',
    'benchmarks': rf'rosidl\w*|lark|cv_bridge|{MESSAGES}|{PACKAGE}\.nodes',
}
#: The perception core knows no files, devices or processes either.
CORE_THIRD_PARTY = frozenset({'numpy', 'numba', 'cv2', 'scipy', 'onnxruntime', PACKAGE})
CORE_STDLIB_DENIED = frozenset({
    'os', 'io', 'pathlib', 'shutil', 'tempfile', 'subprocess', 'multiprocessing', 'socket', 'sys', 'sqlite3'})
#: But the processors that a thread may run on.
CORE_STDLIB_ALLOWED = frozenset({'os.getpid', 'os.sched_getaffinity', 'os.sched_setaffinity'})
CORE_CALLS_DENIED = frozenset({'open', 'imread', 'imwrite', 'VideoCapture', 'VideoWriter', 'imshow'})


def violations(layer: str, source: str) -> list[str]:
    """Every rule that the source of a module of ``layer`` ('' = the package itself) breaks, one line each."""
    tree = ast.parse(source)
    return [*_imports(layer, tree), *_lengths(layer, source, tree), *_asserts(tree),
            *(_core_only(tree) if layer == 'core' else ())]


def imported_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of everything imported anywhere in a module, inside functions and by name too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                yield node.lineno, '.' * node.level + (node.module or '')
            else:
                yield from ((node.lineno, f'{node.module}.{alias.name}') for alias in node.names)
        elif isinstance(node, ast.Call) and _called(node) in ('import_module', '__import__'):
            yield from ((node.lineno, str(word.value)) for word in node.args[:1] if isinstance(word, ast.Constant))


def _imports(layer: str, tree: ast.AST) -> Iterator[str]:
    denied = re.compile(rf'(?:{FORBIDDEN[layer]})(?:\.|$)')
    for line, name in imported_names(tree):
        if name.startswith('.'):
            yield f'line {line}: relative import {name}'
        elif denied.match(name):
            yield f'line {line}: {layer or "the package"} imports {name}'


def _core_only(tree: ast.AST) -> Iterator[str]:
    for line, name in imported_names(tree):
        top = name.split('.', maxsplit=1)[0]
        if name in CORE_STDLIB_ALLOWED:
            continue
        if top in CORE_STDLIB_DENIED or (top not in CORE_THIRD_PARTY and top not in sys.stdlib_module_names):
            yield f'line {line}: core imports {top}'
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _called(node) in CORE_CALLS_DENIED:
            yield f'line {node.lineno}: core calls {_called(node)}'


def _lengths(layer: str, source: str, tree: ast.AST) -> Iterator[str]:
    allowed, lines = MAX_NODE_LINES if layer == 'nodes' else MAX_MODULE_LINES, len(source.splitlines())
    if lines > allowed:
        yield f'{lines} lines, expected at most {allowed}'
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or 0) - node.lineno + 1
            if length > MAX_FUNCTION_LINES:
                yield f'line {node.lineno}: {node.name} has {length} lines, expected at most {MAX_FUNCTION_LINES}'


def _asserts(tree: ast.AST) -> Iterator[str]:
    return (f'line {node.lineno}: assert' for node in ast.walk(tree) if isinstance(node, ast.Assert))


def _called(node: ast.Call) -> str:
    return getattr(node.func, 'attr', None) or getattr(node.func, 'id', '')


def _layer(module: Path) -> str:
    parts = module.relative_to(ROOT).parts
    return parts[0] if len(parts) > 1 else ''


MODULES = sorted(ROOT.rglob('*.py'))


def test_every_folder_is_a_known_layer() -> None:
    assert {_layer(module) for module in MODULES} == {'', *LAYERS}


@pytest.mark.parametrize('module', MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_module_keeps_to_its_layer(module: Path) -> None:
    assert violations(_layer(module), module.read_text(encoding='utf-8')) == []


def room_violations(room: str, source: str) -> list[str]:
    """Imports of a module of the core in ``room`` ('' = a foundation) that go up the order of rooms."""
    allowed = {*FOUNDATION, *(ROOMS[:ROOMS.index(room) + 1] if room else ())}
    names = [(line, name.split('.')) for line, name in imported_names(ast.parse(source))]
    return [f'line {line}: {room or "a foundation"} imports {parts[2]}' for line, parts in names
            if parts[:2] == [PACKAGE, 'core'] and parts[2] not in allowed]


def _room(module: Path) -> str | None:
    """Room of a module of the core; None for what puts rooms together."""
    parts = module.relative_to(ROOT / 'core').parts
    if len(parts) > 1:
        return parts[0]
    return '' if module.stem in FOUNDATION else None


CORE_MODULES = sorted((ROOT / 'core').rglob('*.py'))


def test_every_folder_of_the_core_is_a_known_room() -> None:
    assert {_room(module) for module in CORE_MODULES} == {None, '', *ROOMS}


@pytest.mark.parametrize('module', [module for module in CORE_MODULES if _room(module) is not None],
                         ids=lambda path: str(path.relative_to(ROOT / 'core')))
def test_module_imports_its_own_and_earlier_rooms_only(module: Path) -> None:
    assert room_violations(_room(module) or '', module.read_text(encoding='utf-8')) == []


@pytest.mark.parametrize(('room', 'source', 'complaint'), [
    ('ego_motion', 'from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage', 'imports optical_flow'),
    ('', 'from motion_detect_ros.core.geometry.warp import apply', 'a foundation imports geometry'),
    ('geometry', 'def f():\n    import motion_detect_ros.core.pipeline', 'geometry imports pipeline'),
])
def test_room_checker_sees_a_violation(room: str, source: str, complaint: str) -> None:
    assert [line for line in room_violations(room, source) if line.endswith(complaint)]


def import_cycles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Modules that import each other in a circle, at the top or inside functions (Tarjan's components by two walks)."""
    def reachable(start: str) -> set[str]:
        seen, stack = set(), [start]
        while stack:
            for name in imports[stack.pop()] - seen:
                seen.add(name)
                stack.append(name)
        return seen

    reach = {name: reachable(name) for name in imports}
    circles = {frozenset(other for other in reach[name] if name in reach[other]) for name in imports
               if name in reach[name]}
    return sorted(sorted(circle) for circle in circles)


def test_no_module_is_part_of_an_import_circle() -> None:
    name_of = {module: f'{PACKAGE}.{".".join(module.relative_to(ROOT).with_suffix("").parts)}' for module in MODULES}
    known = set(name_of.values())
    imports = {}
    for module, name in name_of.items():
        found = [each for _, each in imported_names(ast.parse(module.read_text(encoding='utf-8')))]
        imports[name] = {target for each in found for target in (each, each.rpartition('.')[0]) if target in known}
    assert import_cycles(imports) == []


def test_circles_are_seen() -> None:
    assert import_cycles({'a': {'b'}, 'b': {'c'}, 'c': {'b'}, 'd': {'d'}, 'e': {'a'}}) == [['b', 'c'], ['d']]


def test_core_sources_and_results_load_without_ros() -> None:
    """What the imports say, run: a process that cannot import ROS loads these layers whole."""
    names = [f'{PACKAGE}.{".".join(module.relative_to(ROOT).with_suffix("").parts)}'
             for module in MODULES if _layer(module) in ('core', 'sources', 'results') and module.stem != '__init__']
    code = textwrap.dedent(f'''
        import importlib, importlib.abc, re, sys
        class NoRos(importlib.abc.MetaPathFinder):
            def find_spec(self, name, path=None, target=None):
                if re.fullmatch(r"{ROS}", name):
                    raise ImportError(f"{{name}} is not here")
        sys.meta_path.insert(0, NoRos())
        for name in {names!r}:
            importlib.import_module(name)
    ''')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


BROKEN = {
    ('core', 'import rclpy'): 'line 1: core imports rclpy',
    ('core', 'def f():\n    from sensor_msgs.msg import Image'): 'line 2: core imports sensor_msgs.msg.Image',
    ('core', 'from motion_detect_ros.sources.bags import BagReader'):
        'line 1: core imports motion_detect_ros.sources.bags.BagReader',
    ('core', 'from motion_detect_ros import bridge'): 'line 1: core imports motion_detect_ros.bridge',
    ('core', 'from ..sources import bags'): 'line 1: relative import ..sources',
    ('core', 'import rosbags'): 'line 1: core imports rosbags',
    ('core', 'import pathlib'): 'line 1: core imports pathlib',
    ('core', 'from os import getpid, remove'): 'line 1: core imports os',
    ('core', "open('x')"): 'line 1: core calls open',
    ('core', "import cv2\ncv2.imread('x')"): 'line 2: core calls imread',
    ('core', 'def f(x):\n    assert x'): 'line 2: assert',
    ('sources', 'import rclpy.node'): 'line 1: sources imports rclpy.node',
    ('sources', 'from builtin_interfaces.msg import Time'): 'line 1: sources imports builtin_interfaces.msg.Time',
    ('sources', 'from motion_detect_ros.cli import convert'):
        'line 1: sources imports motion_detect_ros.cli.convert',
    ('sources', "import importlib\nimportlib.import_module('rclpy')"): 'line 2: sources imports rclpy',
    ('results', 'from sensor_msgs.msg import Image'): 'line 1: results imports sensor_msgs.msg.Image',
    ('results', 'from motion_detect_ros.cli.replay import Job'):
        'line 1: results imports motion_detect_ros.cli.replay.Job',
    ('sources', 'from motion_detect_ros.results.files import CSV_NAME'):
        'line 1: sources imports motion_detect_ros.results.files.CSV_NAME',
    ('results', 'from motion_detect_ros.report.make import make_report'):
        'line 1: results imports motion_detect_ros.report.make.make_report',
    ('report', 'from motion_detect_ros.cli.evaluate import evaluate'):
        'line 1: report imports motion_detect_ros.cli.evaluate.evaluate',
    ('bridge', 'from motion_detect_ros.results.rows import csv_rows'):
        'line 1: bridge imports motion_detect_ros.results.rows.csv_rows',
    ('bridge', 'from rosidl_runtime_py import utilities'): 'line 1: bridge imports rosidl_runtime_py.utilities',
    ('bridge', 'import motion_detect_ros.nodes.camera'): 'line 1: bridge imports motion_detect_ros.nodes.camera',
    ('nodes', 'import cv2'): 'line 1: nodes imports cv2',
    ('nodes', 'from numba import njit'): 'line 1: nodes imports numba.njit',
    ('nodes', 'from sensor_msgs.msg import Image'): 'line 1: nodes imports sensor_msgs.msg.Image',
    ('nodes', 'from std_srvs.srv import Trigger'): 'line 1: nodes imports std_srvs.srv.Trigger',
    ('nodes', '\n' * 151): '151 lines, expected at most 150',
    ('cli', 'from nav_msgs.msg import Odometry'): 'line 1: cli imports nav_msgs.msg.Odometry',
    ('cli', 'from motion_detect_ros.benchmarks import bench'):
        'line 1: cli imports motion_detect_ros.benchmarks.bench',
    ('benchmarks', '\n' * 301): '301 lines, expected at most 300',
    ('benchmarks', 'def f():\n' + '    pass\n' * 60): 'line 1: f has 61 lines, expected at most 60',
    ('', 'from std_msgs.msg import Header'): 'the package imports std_msgs.msg.Header',
}


@pytest.mark.parametrize(('case', 'complaint'), BROKEN.items(), ids=lambda value: None)
def test_checker_sees_a_violation(case: tuple[str, str], complaint: str) -> None:
    found = violations(*case)
    assert any(line.endswith(complaint) for line in found), found


@pytest.mark.parametrize(('layer', 'source'), [
    ('core', 'import cv2\nimport numpy as np\nfrom motion_detect_ros.core.types import Result'),
    ('core', 'from scipy.optimize import linear_sum_assignment\nfrom enum import IntEnum'),
    ('sources', 'import rosbags\nfrom pathlib import Path\nfrom motion_detect_ros.core import types'),
    ('bridge', 'import rclpy\nfrom sensor_msgs.msg import Image\nfrom std_srvs.srv import Trigger'),
    ('nodes', 'import rclpy\nfrom motion_detect_ros.bridge.images import image_to_msg'),
    ('benchmarks', 'import cv2\nimport rclpy\nfrom motion_detect_ros.bridge.records import read_detections'),
    ('nodes', '\n' * 150),
    ('core', 'def f():\n' + '    pass\n' * 59),
])
def test_checker_accepts_what_is_right(layer: str, source: str) -> None:
    assert violations(layer, source) == []
