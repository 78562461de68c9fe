"""Licences of what the lock installs, and the bill of materials."""

from __future__ import annotations

import json
import subprocess
from email.message import Message
from pathlib import Path

import pytest

from motion_detect_ros.benchmarks.dependencies import Dependency, dependencies, locked, table
from motion_detect_ros.core.errors import ConfigError

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / 'requirements.lock'
COMMAND = 'run python -m motion_detect_ros.benchmarks.dependencies --write docs/dependencies.md'


@pytest.mark.parametrize(('licence', 'kind'), [
    ('MIT', 'permissive'), ('Apache License 2.0', 'permissive'), ('BSD-3-Clause AND 0BSD', 'permissive'),
    ('Mozilla Public License 2.0 (MPL 2.0)', 'file copyleft'), ('LGPL-2.1-or-later', 'file copyleft'),
    ('GNU Lesser General Public License v3', 'file copyleft'), ('MPL-2.0 AND MIT', 'file copyleft'),
    ('GPL-3.0-only', 'copyleft'), ('GNU Affero General Public License v3', 'copyleft'),
    ('BSD License and GNU General Public License (GPL)', 'copyleft'), ('MIT OR GPL-2.0', 'permissive'),
    ('GPL-3.0-or-later AND MIT', 'copyleft'), ('MIT AND GPL-3.0-or-later', 'copyleft'),
    ('GPL-2.0 or later and MIT', 'copyleft'), ('GPL v2 or any later version', 'copyleft'),
    ('GPL-3.0-or-later OR MIT', 'permissive'), ('LGPL-2.1-or-later AND MIT', 'file copyleft'),
    ('MIT AND BSD-3-Clause AND Apache-2.0 AND ISC AND Zlib AND PSF-2.0 AND GPL-3.0-only', 'copyleft'),
    ('', 'unknown'), ('All rights reserved', 'unknown'),
])
def test_kinds_of_licences(licence, kind):
    assert Dependency('some', '1', licence).kind == kind


def test_a_long_licence_is_judged_as_a_whole_and_short_in_the_table(monkeypatch, tmp_path):
    said = Message()
    said['Version'], said['License-Expression'] = '1.0', f'{"MIT AND " * 10}GPL-3.0-only'
    monkeypatch.setattr('motion_detect_ros.benchmarks.dependencies.metadata', lambda name: said)
    lock = tmp_path / 'requirements.lock'
    lock.write_text('some==1.0\n')
    (found,) = dependencies(lock)
    assert found.kind == 'copyleft'
    assert table([found])[-1] == f'| some | 1.0 | {("MIT AND " * 10)[:60].rstrip()} ... | copyleft |'


@pytest.mark.parametrize(('said', 'kind'), [
    ({'License-Expression': 'MIT'}, 'permissive'), ({'License': 'MIT'}, 'permissive'),
    ({'Classifier': 'License :: OSI Approved :: MIT License'}, 'permissive'), ({}, 'unknown')])
def test_what_metadata_does_not_say_is_none(monkeypatch, tmp_path, said, kind):
    """importlib_metadata, where something has imported it, raises KeyError for it; importlib.metadata gives None."""
    class Raising(Message):
        def __getitem__(self, name):
            if name not in self:
                raise KeyError(name)
            return super().__getitem__(name)

    written = Raising()
    for name, value in {'Version': '1.0', **said}.items():
        written[name] = value
    monkeypatch.setattr('motion_detect_ros.benchmarks.dependencies.metadata', lambda name: written)
    lock = tmp_path / 'requirements.lock'
    lock.write_text('some==1.0\n')
    (found,) = dependencies(lock)
    assert found.kind == kind


def test_every_dependency_may_be_combined_with_ours_and_the_page_says_so():
    try:
        found = dependencies(LOCK)
    except ConfigError as error:
        pytest.skip(f'not the environment of the lock: {error}')
    assert len(found) == len(list(locked(LOCK))) > 50
    assert {one.name: one.licence for one in found if one.kind not in {'permissive', 'file copyleft'}} == {}
    page = (ROOT / 'docs' / 'dependencies.md').read_text(encoding='utf-8')
    assert '\n'.join(table(found)) in page, COMMAND


def test_a_lock_that_is_not_installed_is_named(tmp_path):
    lock = tmp_path / 'requirements.lock'
    lock.write_text('# comment\nnumpy==0.0.1\n')
    with pytest.raises(ConfigError, match=r'numpy: expected version 0\.0\.1, got \d'):
        dependencies(lock)
    lock.write_text('no-such-package-at-all==1.0  # pinned\n')
    with pytest.raises(ConfigError, match='no-such-package-at-all: expected version 1.0, found none'):
        dependencies(lock)


def test_bill_of_materials_holds_what_is_locked(tmp_path):
    """``make sbom`` checks it against the schema."""
    tool = ROOT / '.venv-audit' / 'bin' / 'cyclonedx-py'
    if not tool.is_file():
        pytest.skip('no CycloneDX here: make sbom')
    bill = tmp_path / 'sbom.json'
    subprocess.run([tool, 'environment', '--validate', '--of', 'JSON', '-o', bill, ROOT / '.venv' / 'bin' / 'python'],
                   check=True, capture_output=True, timeout=300)
    written = json.loads(bill.read_text())
    assert written['bomFormat'] == 'CycloneDX'
    versions = {part['name'].lower().replace('_', '-'): part['version'] for part in written['components']}
    for name, version in locked(LOCK):
        assert versions[name.lower().replace('_', '-')] == version
