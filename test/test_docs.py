"""The pages of docs/ name what there is: every topic and parameter; files, functions and settings that exist."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from reliability import rows_of_tests

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.types import DETECTION_DTYPE, EgoStatus, MotionModel
from motion_detect_ros.launched_detector import ARGUMENTS
from motion_detect_ros.presets import NODE_PARAMETERS
from motion_detect_ros.sources.encoding import ENCODINGS

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / 'motion_detect_ros'
#: How far the sizes that docs/architecture.md states may be off, share of the truth.
LINES_TOLERANCE = 0.1
PAGE = (ROOT / 'docs' / 'nodes.md').read_text(encoding='utf-8')
QUOTED = set(re.findall(r'`([^`]+)`', PAGE))


def topics() -> set[str]:
    source = (ROOT / 'motion_detect_ros' / 'bridge' / 'topics.py').read_text(encoding='utf-8')
    return set(re.findall(r"\bTopic\(\s*'([^']+)'", source))


def launch_arguments(name: str) -> dict[str, str]:
    """Argument -> default, of the tuples (name, default, what it means)."""
    if name == 'motion_detect.launch.py':
        return {argument: default for argument, default, _ in ARGUMENTS}
    tree = ast.parse((ROOT / 'launch' / name).read_text(encoding='utf-8'))
    tables = [node.value for node in tree.body if isinstance(node, ast.Assign)
              and getattr(node.targets[0], 'id', '') == 'OWN']
    return {argument: default for table in tables for argument, default, _ in ast.literal_eval(table)}


def test_topics_and_parameters():
    assert {'ego_motion', 'detections_2d', '~/markers', '/clock'} <= topics()
    assert topics() <= QUOTED
    assert NODE_PARAMETERS <= QUOTED


def test_encodings_of_images():
    section = PAGE[PAGE.index('`image_raw` is `sensor_msgs/Image`'):]
    named = set(re.findall(r'\w+', section[:section.index('16-bit images')]))
    assert {name for name in ENCODINGS if not name.startswith('bayer_')} <= named


def test_fields():
    assert set(DETECTION_DTYPE.names or ()) <= QUOTED
    for each in (*EgoStatus, *MotionModel):
        assert f'{each.value} {each.name.lower().replace("_", " ")}' in PAGE


@pytest.mark.parametrize('name', ['motion_detect.launch.py', 'replay.launch.py', 'cameras.launch.py'])
def test_launch_arguments_and_their_defaults(name: str):
    section = PAGE[PAGE.index('## Launch files'):]
    assert launch_arguments(name)
    for argument, default in launch_arguments(name).items():
        row = re.search(rf'\| `{argument}` \|([^|]*)\|', section)
        assert row, argument
        assert not default or f'`{default}`' in row[1], argument


def words_given(line: str) -> Iterator[tuple[str, str]]:
    """``-p``, ``-r`` or nothing, and the name, of each ``name:=value`` in a line of a page."""
    return ((flag.strip(), name) for flag, name in re.findall(r'(-[pr] |)(?<![\w./])([A-Za-z][\w./]*):=', line))


@pytest.mark.parametrize('page', ['README.md', *(f'docs/{path.name}' for path in sorted((ROOT / 'docs').glob('*.md')))])
def test_what_is_given_on_command_lines_exists(page: str):
    """Behind ``-p`` parameters of the nodes or examples, else launch arguments, in a launch those of its file."""
    detector, camera = set(launch_arguments('motion_detect.launch.py')), {'source', 'frame_id'}
    known = {'motion_detect.launch.py': detector,
             'replay.launch.py': {*launch_arguments('replay.launch.py'),
                                  *detector} - camera - {'camera', 'use_sim_time'},
             'cameras.launch.py': {*launch_arguments('cameras.launch.py'), *detector} - camera}
    examples = ''.join(path.read_text(encoding='utf-8') for path in (ROOT / 'examples').glob('*.py'))
    for line in (ROOT / page).read_text(encoding='utf-8').splitlines():
        launched = re.search(r'ros2 launch motion_detect_ros (\S+)', line)
        for flag, name in words_given(line):
            if flag == '-p' and 'usb_cam_node_exe' not in line:
                assert name in NODE_PARAMETERS or f"'{name}'" in examples, line
            elif not flag and name not in {'logger', 'NAME', 'FROM'}:
                assert name in (known[launched[1]] if launched else set().union(*known.values())), line


def test_documents_linked_from_the_pages_exist():
    for page in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')):
        for target in re.findall(r'\]\(([^)#]+)', page.read_text(encoding='utf-8')):
            assert (page.parent / target).exists() or '://' in target, f'{page.name}: {target}'


def headings(path: Path) -> set[str]:
    """The anchors of a page, as GitHub makes them of its headings."""
    lines = re.findall(r'^#+ +(.+?) *$', path.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w -]', '', line.lower()).replace(' ', '-') for line in lines}


def test_headings_linked_from_the_pages_exist():
    linked = [(page.parent / (target or page.name), anchor)
              for page in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md'))
              for target, anchor in re.findall(r'\]\(((?!\w+:)[^)#]*)#([^)]+)', page.read_text(encoding='utf-8'))]
    assert len(linked) > 10
    assert [(path.name, anchor) for path, anchor in linked if anchor not in headings(path)] == []


def test_rows_of_the_reliability_page_are_those_that_tests_show():
    rows = re.findall(r'^\| (.+?) \| (.+?) \| .+ \| `[^`]+` \|$', page('reliability.md'), re.MULTILINE)
    assert len(rows) == len(set(rows)) > 10
    assert set(rows) == rows_of_tests(ROOT / 'test')


def page(name: str) -> str:
    return (ROOT / 'docs' / name).read_text(encoding='utf-8')


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding='utf-8').splitlines())


@pytest.mark.parametrize('name', ['architecture.md', 'method.md'])
def test_modules_named_on_the_page_exist(name: str):
    named = set(re.findall(r'`([\w/]+\.py)`', page(name)))
    assert named
    assert [module for module in sorted(named) if not ((PACKAGE / module).is_file() or (ROOT / module).is_file())] == []


def definitions() -> dict[str, set[str]]:
    """Names of the core's modules and classes -> every function and class that their files define."""
    found: dict[str, set[str]] = {}
    for path in (PACKAGE / 'core').rglob('*.py'):
        nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
                 if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        for owner in (path.stem, *(node.name for node in nodes if isinstance(node, ast.ClassDef))):
            found.setdefault(owner, set()).update(node.name for node in nodes)
    return found


def test_functions_and_settings_named_by_the_method_page_exist():
    """`owner.name` is a function or class of a module or class of the core, or a setting."""
    known, options = definitions(), {name for name, _, _ in settings(PipelineConfig())}
    named = re.findall(r'`(\w+)\.(?!py`|md`)(\w+)`', page('method.md'))
    assert len(named) > 10
    assert [f'{owner}.{name}' for owner, name in named
            if f'{owner}.{name}' not in options and name not in known.get(owner, ())] == []


def setting_columns(text: str) -> Iterator[tuple[str, str]]:
    """(group, name) of every setting in table columns that are headed "settings (`group.`)" or the like."""
    column, group = 0, ''
    for line in text.splitlines():
        cells = re.split(r'(?<!\\)\|', line)
        column = column if line.startswith('|') else 0
        for number, cell in enumerate(cells):
            if head := re.search(r'\(`(\w+)\.`\)', cell):
                column, group = number, head[1]
        if column:
            yield from ((group, name) for name in re.findall(r'`(\w+)`', cells[column]))


def test_settings_in_the_tables_of_the_method_page_exist():
    options = {name for name, _, _ in settings(PipelineConfig())}
    named = {f'{group}.{name}' for group, name in setting_columns(page('method.md'))}
    assert {'art2.vigilance', 'objects.join_match', 'tracks.confirm_s'} <= named
    assert named - options == set()


def reading_path() -> dict[str, int]:
    """Module -> lines, as the page states them."""
    return {module: int(lines) for module, lines in re.findall(r'^\| `(core/[^`]+)` \| (\d+) \|',
                                                               page('architecture.md'), re.MULTILINE)}


def test_length_of_the_reading_path():
    stated, true = reading_path(), sum(lines_of(PACKAGE / module) for module in reading_path())
    total = re.search(r'order of a frame, ([\d,]+) lines', page('architecture.md'))
    assert total
    assert int(total[1].replace(',', '')) == sum(stated.values())
    assert sum(stated.values()) == pytest.approx(true, rel=LINES_TOLERANCE)


def test_reading_path_shows_no_alternatives():
    assert [module for module in reading_path() if '/alternatives/' in module] == []


def test_rooms_stand_on_the_page_in_the_order_of_their_imports():
    tree = ast.parse((ROOT / 'test' / 'test_layering.py').read_text(encoding='utf-8'))
    rooms = next(ast.literal_eval(node.value) for node in tree.body
                 if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == 'ROOMS')
    sentence = page('architecture.md').split('the rooms are ordered:')[1].split('. A room')[0]
    assert tuple(re.findall(r'`(\w+)`', sentence)) == rooms
