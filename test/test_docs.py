"""docs/nodes.md names every topic, field, parameter and launch argument that there is."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from motion_detect_ros.core.types import DETECTION_DTYPE, EgoStatus, MotionModel
from motion_detect_ros.presets import NODE_PARAMETERS

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / 'docs' / 'nodes.md').read_text(encoding='utf-8')
QUOTED = set(re.findall(r'`([^`]+)`', PAGE))


def topics() -> set[str]:
    source = (ROOT / 'motion_detect_ros' / 'bridge' / 'topics.py').read_text(encoding='utf-8')
    return set(re.findall(r"\bTopic\(\s*'([^']+)'", source))


def launch_arguments(name: str) -> dict[str, str]:
    """Argument -> default, of the tuples (name, default, what it means)."""
    tree = ast.parse((ROOT / 'launch' / name).read_text(encoding='utf-8'))
    tables = [node.value for node in tree.body if isinstance(node, ast.Assign)
              and getattr(node.targets[0], 'id', '') in {'ARGUMENTS', 'OWN'}]
    return {argument: default for table in tables for argument, default, _ in ast.literal_eval(table)}


def test_topics_and_parameters():
    assert {'ego_motion', 'detections_2d', '~/markers', '/clock'} <= topics()
    assert topics() <= QUOTED
    assert NODE_PARAMETERS <= QUOTED


def test_fields():
    assert set(DETECTION_DTYPE.names or ()) <= QUOTED
    for each in (*EgoStatus, *MotionModel):
        assert f'{each.value} {each.name.lower().replace("_", " ")}' in PAGE


@pytest.mark.parametrize('name', ['motion_detect.launch.py', 'replay.launch.py'])
def test_launch_arguments_and_their_defaults(name: str):
    section = PAGE[PAGE.index('## Launch files'):]
    assert launch_arguments(name)
    for argument, default in launch_arguments(name).items():
        row = re.search(rf'\| `{argument}` \|([^|]*)\|', section)
        assert row, argument
        assert not default or f'`{default}`' in row[1], argument


def test_documents_linked_from_the_pages_exist():
    for page in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')):
        for target in re.findall(r'\]\(([^)#]+)', page.read_text(encoding='utf-8')):
            assert (page.parent / target).exists() or '://' in target, f'{page.name}: {target}'
