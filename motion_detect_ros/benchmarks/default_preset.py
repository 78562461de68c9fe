"""Writes the default preset: ``python -m motion_detect_ros.benchmarks.default_preset config/default.yaml``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import settings

HEADER = '''# The default preset: every setting with its default value, unit and range.
# Serves as --params-file for every node and as --preset default offline.
/**:
  ros__parameters:
'''


def default_preset() -> str:
    """The text of the file: one commented line for each setting."""
    lines, group = [], ''
    for name, value, metadata in settings(PipelineConfig()):
        section, _, leaf = name.partition('.')
        if section != group:
            lines.append(f'    {section}:')
            group = section
        unit = f' [{metadata["unit"]}]' if metadata['unit'] else ''
        lines.append(f'      {leaf}: {_yaml(value)}  # {metadata["doc"]}{unit}{_allowed(metadata)}')
    return HEADER + '\n'.join(lines) + '\n'


def _yaml(value: bool | float | str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value if isinstance(value, str) and value else repr(value)


def _allowed(metadata: Mapping[str, Any]) -> str:
    if metadata['choices']:
        return f' ({" | ".join(metadata["choices"])})'
    return '' if metadata['low'] is None else f' ({metadata["low"]} .. {metadata["high"]})'


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(default_preset(), encoding='utf-8')
