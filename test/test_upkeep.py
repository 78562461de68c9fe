"""What keeps the project going: workflows, hooks, templates, citation and declarations say what is true of it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from motion_detect_ros import __version__

ROOT = Path(__file__).resolve().parent.parent
WORKFLOWS = sorted((ROOT / '.github' / 'workflows').glob('*.yml'))
TEMPLATES = sorted(path for path in (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('*.yml') if path.stem != 'config')


def loaded(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding='utf-8'))


def make_targets() -> set[str]:
    return set(re.findall(r'^([\w-]+):(?!=)', (ROOT / 'Makefile').read_text(encoding='utf-8'), re.MULTILINE))


def commands(workflow: Path) -> str:
    """Everything that its steps run, continued lines joined."""
    steps = [step for job in loaded(workflow)['jobs'].values() for step in job['steps']]
    return re.sub(r'\\\n\s*', ' ', '\n'.join(step['run'] for step in steps if 'run' in step))


def test_there_are_workflows_for_both_ways_to_install():
    assert [path.stem for path in WORKFLOWS] == ['jazzy', 'wheels']
    runners = loaded(WORKFLOWS[0])['jobs']['test']['strategy']['matrix']['runner']
    assert set(runners) == {'ubuntu-24.04', 'ubuntu-24.04-arm'}


@pytest.mark.parametrize('path', WORKFLOWS, ids=lambda path: path.stem)
def test_workflow_is_laid_out_as_one(path: Path):
    workflow = loaded(path)
    assert workflow[True], 'YAML reads "on" as true'
    assert workflow['permissions'] == {'contents': 'read'}
    for job in workflow['jobs'].values():
        assert str(job['runs-on']).startswith(('ubuntu-', '${{ matrix.'))
        for name in re.findall(r'\$\{\{ matrix\.(\w+) \}\}', str(job)):
            assert name in job['strategy']['matrix']
        for step in job['steps']:
            assert ('run' in step) != ('uses' in step)
            assert 'uses' not in step or re.fullmatch(r'actions/[\w-]+@v\d+', step['uses'])


@pytest.mark.parametrize('path', WORKFLOWS, ids=lambda path: path.stem)
def test_workflow_runs_what_exists(path: Path):
    text = commands(path)
    called = set(re.findall(r'\bmake ([\w-]+)', text)) - {'python3-pip'}
    assert called <= make_targets()
    assert all((ROOT / folder).is_dir() for folder in re.findall(r'\b(test/\w+)', text))
    for script in text.split('\n'):
        done = subprocess.run(['bash', '-n', '-c', script], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_workflow_runs_the_tests_that_the_makefile_runs_with_ubuntus_versions():
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    listed = re.search(r'JAZZY\)/bin/python -m pytest (.*)', makefile)
    assert listed is not None
    assert re.findall(r'test/\w+', listed[1]) == re.findall(r'test/\w+', commands(WORKFLOWS[0]))


def test_installation_is_that_of_the_readme():
    wanted = re.search(r'pip install --break-system-packages [\w ]+?(?=  |\n)', (ROOT / 'README.md').read_text())
    assert wanted is not None
    assert f'{wanted[0]}\n' in f'{commands(WORKFLOWS[0])}\n'


def test_make_targets_that_documents_name_exist():
    for path in (ROOT / 'CONTRIBUTING.md', ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')):
        called = set(re.findall(r'(?:`|^    )make ([\w-]+)', path.read_text(encoding='utf-8'), re.MULTILINE))
        assert called <= make_targets(), path.name


def test_hooks_run_programs_and_files_that_setup_brings():
    (local,) = loaded(ROOT / '.pre-commit-config.yaml')['repos']
    assert local['repo'] == 'local'
    lock = (ROOT / 'requirements.lock').read_text(encoding='utf-8')
    for hook in local['hooks']:
        program, *words = hook['entry'].split()
        assert program.startswith('.venv/bin/')
        assert program.endswith('python') or f'\n{Path(program).name}==' in lock
        assert all((ROOT / word).is_file() for word in words if word.startswith('test/'))


@pytest.mark.parametrize('path', TEMPLATES, ids=lambda path: path.stem)
def test_issue_template_is_a_form(path: Path):
    form = loaded(path)
    assert {'name', 'description', 'body'} <= set(form)
    fields = [field for field in form['body'] if field['type'] != 'markdown']
    assert fields
    assert len({field['id'] for field in fields}) == len(fields)
    for field in fields:
        assert field['type'] in {'input', 'textarea', 'checkboxes', 'dropdown'}
        assert field['attributes']['label']


def test_citation_is_of_this_version_and_license():
    citation = loaded(ROOT / 'CITATION.cff')
    assert (citation['cff-version'], citation['version']) == ('1.2.0', __version__)
    assert citation['license'] == ElementTree.parse(ROOT / 'package.xml').getroot().findtext('license')


def test_quality_level_is_the_honest_one():
    """REP 2004: without a copyright statement in each source file it is 5; 3 and better need a stable version."""
    declaration = (ROOT / 'QUALITY_DECLARATION.md').read_text(encoding='utf-8')
    (level,) = re.findall(r'\*\*Quality Level (\d)\*\*', declaration)
    sources = sorted((ROOT / 'motion_detect_ros').rglob('*.py'))
    stated = all('copyright' in path.read_text(encoding='utf-8')[:500].lower() for path in sources)
    assert level == ('4' if stated else '5')
    assert __version__.startswith('0.'), 'a stable version may claim more'
    for target in re.findall(r'\]\(([^)#]+)', declaration):
        assert (ROOT / target).exists()
