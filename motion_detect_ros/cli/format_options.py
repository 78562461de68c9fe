"""Options of ``replay`` for the files that it writes."""

from __future__ import annotations

import argparse

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.formats import DEFAULT_FORMATS, FORMATS, MCAP, parse_formats


def add_format_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``--formats`` and ``--overlay``."""
    parser.add_argument('--formats', default=','.join(DEFAULT_FORMATS),
                        help=f'of the detections, some of {",".join(FORMATS)} (default %(default)s; csv always)')
    parser.add_argument('--overlay', action='store_true', help='pictures with boxes in detections.mcap, as JPEG')


def formats_of(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Names in ``FORMATS``. Raises: SourceError for options that contradict each other, else as ``parse_formats``."""
    formats = parse_formats(arguments.formats)
    if arguments.live and (arguments.overlay or formats != DEFAULT_FORMATS):
        raise SourceError(f'--live: expected neither --overlay nor other --formats than {",".join(DEFAULT_FORMATS)}')
    if arguments.overlay and MCAP not in formats:
        raise SourceError(f'--overlay: expected {MCAP} among --formats, got {arguments.formats}')
    return formats
