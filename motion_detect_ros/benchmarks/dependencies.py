"""The licences of all locked dependencies.

    python -m motion_detect_ros.benchmarks.dependencies --write docs/dependencies.md

Read from the metadata of what is installed, which must be what ``requirements.lock`` says. Exit codes: 0 done, 1 a
licence that is not known to be compatible, 2 an environment that is not that of the lock.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from xml.etree import ElementTree

from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.errors import ConfigError

LOCK = Path('requirements.lock')
SECTION = 'licences'
#: May be combined with Apache-2.0 without a condition on our code, in the words of SPDX and of older metadata.
PERMISSIVE = re.compile(
    r'\b(apache|mit|bsd|isc|psf|python software foundation|python-2\.0|cnri-python|0bsd|zlib|unlicense|public domain|'
    r'hpnd|cc0|boost|bsl-1\.0|freebsd|any-osi)', re.IGNORECASE)
#: May be used, changed files of it are to be published: no condition on code that only imports it.
FILE_COPYLEFT = re.compile(r'\b(mpl|mozilla public|lgpl|lesser general public)', re.IGNORECASE)
#: May not become part of what is delivered under Apache-2.0.
COPYLEFT = re.compile(r'(?<!l)(?<!lesser )\b(agpl|gpl|general public|affero)', re.IGNORECASE)
#: Read in the files of packages whose metadata say nothing, or less.
READ = {'setuptools': 'MIT', 'docutils': 'public domain and BSD-2-Clause', 'ros-fastrtps': 'Apache-2.0',
        'ros-fastcdr': 'Apache-2.0'}
_CLASSIFIER = 'License :: OSI Approved :: '
_PIN = re.compile(r'^([\w.-]+)==([^\s;]+)')
#: Between licences of which the user may choose; ``-or-later`` and ``or later`` are part of one.
_CHOICE = re.compile(r'\s+or\s+(?!(?:any )?later)', re.IGNORECASE)
#: Of a licence in the table, characters.
_LONGEST = 60


@dataclass(frozen=True)
class Dependency:
    """``licence``: as its metadata says, empty where it does not."""

    name: str
    version: str
    licence: str

    @property
    def kind(self) -> str:
        """permissive, file copyleft, copyleft or unknown; the mildest where the user may choose."""
        choices = _CHOICE.split(self.licence)
        kinds = [_kind(choice) for choice in choices]
        return next((kind for kind in ('permissive', 'file copyleft', 'copyleft') if kind in kinds), 'unknown')


def _kind(licence: str) -> str:
    for kind, words in (('copyleft', COPYLEFT), ('file copyleft', FILE_COPYLEFT), ('permissive', PERMISSIVE)):
        if words.search(licence):
            return kind
    return 'unknown'


def locked(lock: Path) -> Iterator[tuple[str, str]]:
    """Name and version of every pin. Raises: ConfigError for a lock that cannot be read."""
    try:
        lines = lock.read_text(encoding='utf-8').splitlines()
    except OSError as error:
        raise ConfigError(f'{lock}: expected the lock file, got {error.strerror}') from None
    for line in lines:
        if pin := _PIN.match(line):
            yield pin.group(1), pin.group(2)


def dependencies(lock: Path) -> list[Dependency]:
    """All of the lock. Raises: ConfigError where another version is installed, or none."""
    return [_installed(name, version) for name, version in locked(lock)]


def _installed(name: str, version: str) -> Dependency:
    try:
        found = metadata(name)
    except PackageNotFoundError:
        raise ConfigError(f'{name}: expected version {version}, found none') from None
    if found['Version'] != version:
        raise ConfigError(f'{name}: expected version {version}, got {found["Version"]}')
    classified = [each.removeprefix(_CLASSIFIER) for each in found.get_all('Classifier') or ()
                  if each.startswith(_CLASSIFIER)]
    expression, licence = ((found.get_all(field) or [''])[0] for field in ('License-Expression', 'License'))
    said = READ.get(name) or expression or ' and '.join(classified) or licence.strip() or _of_ros_package(name)
    return Dependency(name, version, said.splitlines()[0] if said else '')


def _of_ros_package(name: str) -> str:
    """From the ``package.xml`` that a wheel of ROS 2 brings along; empty where it is none."""
    for package in (name.removeprefix('ros-'), name.removeprefix('ros-jazzy-')):
        manifest = Path(sys.prefix, 'share', package.replace('-', '_'), 'package.xml')
        if manifest.is_file():
            found = [tag.text or '' for tag in ElementTree.parse(manifest).findall('license')]
            return f'{" and ".join(found)} (package.xml)'
    return ''


def table(found: Sequence[Dependency]) -> list[str]:
    """A row for each."""
    return ['| package | version | licence, as it says itself | kind |', '|---|---|---|---|', *(
        f'| {one.name} | {one.version} | {_short(one.licence)} | {one.kind} |' for one in found)]


def _short(licence: str) -> str:
    return licence if len(licence) <= _LONGEST else f'{licence[:_LONGEST].rstrip()} ...'


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog='dependencies', description='Licences of all locked dependencies.')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    found = dependencies(LOCK)
    show(table(found), options.write, SECTION)
    doubtful = [one for one in found if one.kind in {'copyleft', 'unknown'}]
    for one in doubtful:
        print(f'{one.name}: {one.kind}: {one.licence or "says nothing"}', file=sys.stderr)
    return 1 if doubtful else 0


if __name__ == '__main__':
    sys.exit(main())
