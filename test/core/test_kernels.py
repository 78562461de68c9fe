"""Kernels make no arrays: what numba needs for that is a third of what compiling takes at the first start."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

CORE = Path(__file__).resolve().parents[2] / 'motion_detect_ros' / 'core'
#: What no preset but ``report`` uses may.
MODULES = sorted(path for path in CORE.rglob('*.py') if 'alternatives' not in path.parts)
MAKERS = frozenset({'empty', 'zeros', 'ones', 'full', 'array', 'arange', 'empty_like', 'zeros_like', 'ones_like',
                    'full_like', 'copy', 'astype', 'concatenate', 'where', 'sort', 'argsort', 'nonzero'})


def kernels(source: str) -> list[ast.FunctionDef]:
    """Every function under ``@kernel``."""
    return [function for function in ast.walk(ast.parse(source)) if isinstance(function, ast.FunctionDef)
            and any(ast.unparse(each).startswith('kernel') for each in function.decorator_list)]


def made_in_kernels(source: str) -> list[str]:
    """Every call in them that makes an array."""
    return [f'{function.name}: {ast.unparse(node)}' for function in kernels(source) for node in ast.walk(function)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in MAKERS]


def test_the_kernels_are_found():
    """Else the next test would hold nothing."""
    found = {function.name for module in MODULES for function in kernels(module.read_text(encoding='utf-8'))}
    assert {'_compete', 'row_errors', '_strongest', 'median'} <= found


@pytest.mark.parametrize('module', MODULES, ids=lambda module: str(module.relative_to(CORE)))
def test_kernels_fill_the_arrays_of_their_callers(module: Path):
    assert not made_in_kernels(module.read_text(encoding='utf-8'))


@pytest.mark.parametrize(('body', 'found'), [
    ('out = np.zeros(3)', ['f: np.zeros(3)']),
    ('b = a.copy()', ['f: a.copy()']),
    ('b = max(a[0], np.rint(a[1]))', []),
])
def test_what_makes_an_array_is_seen(body: str, found: list[str]):
    assert made_in_kernels(f'@kernel()\ndef f(a):\n    {body}\n') == found
    assert not made_in_kernels(f'def f(a):\n    {body}\n')
