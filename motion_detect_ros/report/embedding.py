"""One file without network: templates filled with everything escaped, and scripts and data inside of the page.

The page's own content security policy names its scripts by their hash and forbids everything from elsewhere, so that
not even a name that got through unescaped could load or run anything.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import importlib.util
import json
import math
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from motion_detect_ros.core.errors import BackendError

if TYPE_CHECKING:
    from jinja2 import Environment

#: Modules that make a report, and what they are called where they are installed from.
NEEDED = {'av': 'av', 'jinja2': 'Jinja2', 'plotly': 'plotly'}


def check_libraries(names: Iterable[str] = NEEDED) -> None:
    """Raises: BackendError where one of the libraries is missing."""
    missing = [NEEDED[name] for name in names if importlib.util.find_spec(name) is None]
    if missing:
        raise BackendError(f'expected {", ".join(missing)}, not installed: pip install {" ".join(missing)}')


def render(template: str, scripts: Iterable[str], late_scripts: Iterable[str] = (), **content: Any) -> str:
    """A page of ``templates/`` with ``style.css`` and the named scripts of that folder in it.

    late_scripts: sources that the page runs itself. Every value of ``content`` is escaped, style and scripts are not.
    """
    texts = [resource(name) for name in scripts]
    return _environment().get_template(template).render(
        **content, style=resource('style.css'), policy=_policy([*texts, *late_scripts]),
        scripts=texts)


def packed(content: str | bytes) -> str:
    """Compressed by gzip, as base64; the same bytes for the same content."""
    raw = content.encode() if isinstance(content, str) else content
    return base64.b64encode(gzip.compress(raw, mtime=0)).decode('ascii')


def as_json(content: Mapping[str, Any]) -> str:
    """Strict JSON. Raises: ValueError for NaN."""
    return json.dumps(content, separators=(',', ':'), allow_nan=False)


def resource(name: str) -> str:
    """A file of ``templates/``."""
    return files('motion_detect_ros.report').joinpath('templates', name).read_text(encoding='utf-8')


@cache
def plotly_source() -> str:
    """plotly.js, as it comes with its Python package: 4.8 MB, packed 1.9."""
    from plotly.offline import get_plotlyjs
    return str(get_plotlyjs())


@cache
def packed_plotly() -> str:
    """plotly.js as ``packed`` leaves it."""
    return packed(plotly_source())


def known(value: float) -> str:
    """A number to sort by; nothing for NaN."""
    return '' if math.isnan(value) else f'{value:.6g}'


def shown(value: float, form: str) -> str:
    """A number for people; nothing for NaN."""
    return '' if math.isnan(value) else form % value


def _policy(scripts: Iterable[str]) -> str:
    hashes = ' '.join(f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
                      for text in scripts)
    return (f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
            "media-src blob:; base-uri 'none'; form-action 'none'")


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    environment = Environment(loader=FunctionLoader(resource), autoescape=True, undefined=StrictUndefined)
    environment.filters.update(known=known, shown=shown)
    return environment
