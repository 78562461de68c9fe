"""Parts of a document that a command writes: between two comments, all else stays as people wrote it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from motion_detect_ros.core.errors import SourceError


def replace_section(document: Path, name: str, lines: Sequence[str]) -> None:
    """Put ``lines`` between ``<!-- generated: NAME -->`` and ``<!-- end: NAME -->``.

    Raises: SourceError where the document does not have both comments, once each and in that order.
    """
    begin, end = f'<!-- generated: {name} -->', f'<!-- end: {name} -->'
    try:
        text = document.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f'{document}: cannot be read: {error}') from None
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise SourceError(f'{document}: expected {begin!r} and after it {end!r}, once each')
    before, rest = text.split(begin)
    after = rest.split(end)[1]
    body = '\n'.join(lines)
    document.write_text(f'{before}{begin}\n{body}\n{end}{after}', encoding='utf-8')


def show(lines: Sequence[str], document: Path | None, name: str) -> None:
    """Print them and, where a document is given, ``replace_section``. Raises: SourceError as that does."""
    print('\n'.join(lines))
    if document:
        replace_section(document, name, lines)
