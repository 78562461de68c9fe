"""Presets: ROS parameter files that also serve offline, read without ROS."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import settings, with_settings

PACKAGE = 'motion_detect_ros'
#: The prefix of an installation is at most so many folders above: PREFIX/lib/python3.12/site-packages, or itself.
PREFIX_LEVELS = 4
#: Parameters of the nodes that are no settings of the perception core; a preset may hold them, offline skips them.
NODE_PARAMETERS = frozenset({
    'autostart', 'bag', 'box_distance_m', 'camera_info_url', 'clock', 'decimation_keep', 'decimation_of', 'first_id',
    'fps', 'frame_id', 'image_reliability', 'image_transport', 'loop', 'play_results', 'position_s', 'queue_size',
    'rate', 'realtime', 'rectified', 'reorder_s', 'source', 'source_secret_file', 'stamp_missing',
    'start_type_description_service', 'topic', 'topics', 'use_sim_time', 'wait_for_nodes', 'wait_for_subscribers',
})

#: Sections of a parameter file that are for all nodes, without slashes; and the one that is written.
ALL_NODES, FOR_ALL = ('**', '*'), '/**'


def is_node_parameter(name: str) -> bool:
    """Whether a parameter belongs to the nodes alone; so do all of the standard ``qos_overrides``."""
    return name in NODE_PARAMETERS or name.startswith('qos_overrides.')


def config_folders() -> Iterator[Path]:
    """Where presets may be, nearest first: the source tree, the prefix that the package was installed into (that of
    ``pip --user``, ``--prefix`` and ``--target`` too), the ament prefixes, the Python installation.
    """
    site = Path(__file__).resolve().parent.parent
    yield site / 'config'
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    above = (site, *site.parents)[:PREFIX_LEVELS]
    for prefix in dict.fromkeys([*above, *map(Path, filter(None, prefixes)), Path(sys.prefix)]):
        yield prefix / 'share' / PACKAGE / 'config'


def find_config(name: str) -> Path:
    """Full path of a file that ships in ``config/``. Raises: ConfigError where no installation holds it."""
    folders = list(config_folders())
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise ConfigError(f'{name}: expected in one of {", ".join(map(str, folders))}, found in none')


def preset_names() -> list[str]:
    """Names of the shipped presets."""
    return sorted(path.stem for path in find_config('default.yaml').parent.glob('*.yaml'))


def load_preset(name_or_path: str | Path) -> PipelineConfig:
    """Settings of a shipped preset (``default``, ``visdrone``, ``kitti``) or of a parameter file.

    Raises: ConfigError, one line, for an unknown preset, an unreadable file, an unknown key or a wrong value.
    """
    path = preset_path(str(name_or_path))
    with _named(path):
        return with_settings(PipelineConfig(), read_parameters(path, lambda name: not is_node_parameter(name)))


def node_sections(name_or_path: str | Path) -> dict[str, dict[str, Any]]:
    """What of a preset only the nodes read: by section, in the order of the file, dotted names and values.

    Raises: ConfigError as ``load_preset``.
    """
    path = preset_path(str(name_or_path))
    with _named(path):
        sections: dict[str, dict[str, Any]] = _read(path, _node_sections)
        return sections


def are_rectified(name_or_path: str | Path) -> bool:
    """Whether a preset calls the images rectified.

    Raises: ConfigError as ``load_preset``, and for neither true nor false.
    """
    path = preset_path(str(name_or_path))
    with _named(path):
        rectified = read_parameters(path, 'rectified'.__eq__).get('rectified', False)
        if isinstance(rectified, bool):
            return rectified
        raise ConfigError(f'rectified: expected true or false, got {rectified!r}')


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Puts the name of a parameter file before what is wrong with it."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f'{path.name}: {error}') from None


def read_parameters(path: Path, wanted: Callable[[str], bool] = lambda name: True) -> dict[str, Any]:
    """Dotted parameter names and values of a ROS parameter file (``/**: ros__parameters:``), of all nodes together.

    wanted: which names. Raises: ConfigError where the file cannot be read or is laid out otherwise, or where sections
    of different nodes have different values of one of them.
    """
    return _read(path, lambda document: _merged(document, wanted))


def value_for(path: Path, node: str, name: str) -> Any:
    """What a ROS parameter file says for a node, by its full name, about a parameter without dots; None for nothing.

    As rclpy takes it: of all sections that match, the last one that has it. Raises: ConfigError as ``read_parameters``.
    """
    full_name = f'/{node.strip("/")}'

    def last(document: Any) -> Any:
        found = None
        for section, parameters in _by_node({} if document is None else document):
            if re.fullmatch(_pattern(str(section)), full_name):
                found = parameters.get(name, found)
        return found
    return _read(path, last)


def _read(path: Path, take: Callable[[Any], Any]) -> Any:
    """What ``take`` makes of a YAML document. Raises: ConfigError."""
    try:
        return take(yaml.safe_load(path.read_text(encoding='utf-8')))
    except (OSError, ValueError, yaml.YAMLError) as error:  # ValueError: no UTF-8, or a date that is none
        reason = str(error).splitlines()[0]
        raise ConfigError(f'expected a YAML parameter file, got {reason}') from None
    except RecursionError:
        raise ConfigError('expected a YAML parameter file, got one nested too deep') from None


def _pattern(node: str) -> str:
    """A regular expression of the full names that a section's name stands for."""
    return re.escape(f'/{node.strip("/")}').replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'(/\w+)')


def _by_node(document: Any, namespace: str = '') -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Names as the file has them, those of nested namespaces with slashes between, and their parameters.

    Raises: ConfigError for another layout, RecursionError for one nested too deep.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(f'expected "/**: ros__parameters:" at the top, got {type(document).__name__}')
    for key, body in document.items():
        node = f'{namespace}/{str(key).strip("/")}' if namespace else key
        if not isinstance(body, Mapping) or not isinstance(body.get('ros__parameters'), Mapping | None):
            raise ConfigError(f'expected "ros__parameters:" under {node!r}')
        inner = {name: part for name, part in body.items() if name != 'ros__parameters'}
        if 'ros__parameters' in body:
            yield node, body['ros__parameters'] or {}
        elif not inner or not all(isinstance(part, Mapping) for part in inner.values()):
            raise ConfigError(f'expected "ros__parameters:" under {node!r}, got {", ".join(map(str, body))}')
        yield from _by_node(inner, str(node))


def _merged(document: Any, wanted: Callable[[str], bool]) -> dict[str, Any]:
    """Of sections that match the same node the last one holds, as in rclpy; one for all nodes matches each.

    Raises: ConfigError for another layout or different values, RecursionError for one nested too deep.
    """
    merged: dict[str, Any] = {}
    node_of: dict[str, Any] = {}
    for node, parameters in _by_node(document):
        for name, value in _flat(parameters):
            if not wanted(name):
                continue
            if str(node).strip('/') in ALL_NODES:
                node_of.pop(name, None)
            elif node_of.setdefault(name, node) != node and merged[name] != value:
                raise ConfigError(f'expected one value of {name}, got {merged[name]!r} under {node_of[name]!r}, '
                                  f'{value!r} under {node!r}')
            merged[name] = value
    return merged


def _node_sections(document: Any) -> dict[str, dict[str, Any]]:
    """Raises: ConfigError for another layout, RecursionError for one nested too deep."""
    found: dict[str, dict[str, Any]] = {}
    for node, parameters in _by_node(document):
        if own := {name: value for name, value in _flat(parameters) if is_node_parameter(name)}:
            found.setdefault(str(node), {}).update(own)
    return found


def write_preset(
    path: Path, config: PipelineConfig, notes: Sequence[str] = (),
    of_nodes: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Write the settings that differ from the defaults as a parameter file; notes: comment lines at its top;
    of_nodes: what only the nodes read, as ``node_sections`` gives it.

    Raises: ConfigError where the file cannot be written.
    """
    defaults = {name: value for name, value, _ in settings(PipelineConfig())}
    changed = {name: value for name, value, _ in settings(config) if value != defaults[name]}
    sections = {**({} if FOR_ALL in (of_nodes or {}) else {FOR_ALL: {}}), **(of_nodes or {})}
    sections[FOR_ALL] = {**changed, **sections[FOR_ALL]}
    text = ''.join(f'# {note}\n' for note in notes) + yaml.safe_dump(
        {name: {'ros__parameters': _grouped(values)} for name, values in sections.items()},
        sort_keys=False, allow_unicode=True)
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ConfigError(f'{path}: the preset cannot be written: {error.strerror}') from None


def preset_path(name: str) -> Path:
    """The file of a shipped preset (by its name), or the given file. Raises: ConfigError where there is none."""
    if name.endswith(('.yaml', '.yml')) or os.sep in name:
        if not Path(name).is_file():
            raise ConfigError(f'{name}: expected a parameter file, found none')
        return Path(name)
    try:
        return find_config(f'{name}.yaml')
    except ConfigError:
        raise ConfigError(f'{name}: expected a preset ({", ".join(preset_names())}) or a YAML file') from None


def _grouped(values: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted names as one level of groups."""
    groups: dict[str, Any] = {}
    for name, value in values.items():
        group, dot, leaf = name.partition('.')
        if dot:
            groups.setdefault(group, {})[leaf] = value
        else:
            groups[name] = value
    return groups


def _flat(values: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
