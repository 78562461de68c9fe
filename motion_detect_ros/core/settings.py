"""Settings: dataclass fields with description, unit and range, iterated and replaced by dotted name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any, TypeVar

from motion_detect_ros.core.errors import ConfigError

Scalar = bool | int | float | str
Config = TypeVar('Config')


def setting(
    default: Scalar, doc: str, *, low: float | None = None, high: float | None = None,
    unit: str = '', choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field with description, unit and allowed values in its metadata."""
    return field(default=default, metadata={
        'doc': doc, 'low': low, 'high': high, 'unit': unit, 'choices': choices})


def settings(config: Any, prefix: str = '') -> Iterator[tuple[str, Scalar, Mapping[str, Any]]]:
    """Iterate over a config: yields (dotted name, value, metadata) of every leaf, in declaration order."""
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        if dataclasses.is_dataclass(value):
            yield from settings(value, f'{prefix}{item.name}.')
        else:
            yield f'{prefix}{item.name}', value, item.metadata


def with_settings(config: Config, values: Mapping[str, Any]) -> Config:
    """A copy of ``config`` with the dotted names in ``values`` replaced.

    Raises: ConfigError for an unknown name, a wrong type, a value outside its range, or values that contradict each
    other (``__post_init__`` of the dataclasses).
    """
    known = {name: (value, metadata) for name, value, metadata in settings(config)}
    tree: dict[str, Any] = {}
    for name, value in values.items():
        if name not in known:
            raise ConfigError(f'unknown setting {name!r}; known: {", ".join(sorted(known))}')
        *groups, leaf = name.split('.')
        node = tree
        for group in groups:
            node = node.setdefault(group, {})
        node[leaf] = _checked(name, value, *known[name])
    replaced: Config = _replaced(config, tree)
    return replaced


def _replaced(node: Any, tree: Mapping[str, Any]) -> Any:
    """All values of a group at once, so that checks across fields see the final group."""
    return dataclasses.replace(node, **{
        name: _replaced(getattr(node, name), value) if isinstance(value, dict) else value
        for name, value in tree.items()})


def _checked(name: str, value: Any, default: Scalar, metadata: Mapping[str, Any]) -> Scalar:
    """``value`` as the type of ``default``, inside the range of ``metadata``."""
    kind = type(default)
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        raise ConfigError(f'{name}: expected {kind.__name__}, got {type(value).__name__} {value!r}')
    if metadata['choices'] and value not in metadata['choices']:
        raise ConfigError(f'{name}: expected one of {", ".join(metadata["choices"])}, got {value!r}')
    low, high = metadata['low'], metadata['high']
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        raise ConfigError(f'{name}: expected {low} to {high}, got {value!r}')
    checked: Scalar = value
    return checked
