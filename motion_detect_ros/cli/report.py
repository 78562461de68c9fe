"""``report``: a page to look at, made of what a replay left behind; ``report index``: the table over many."""

from __future__ import annotations

import argparse
from pathlib import Path

from motion_detect_ros.cli.batch.inputs import size_of
from motion_detect_ros.cli.output_folders import output_path
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.report.index import make_index
from motion_detect_ros.report.make import make_report
from motion_detect_ros.results.summary import read_summary

INDEX = 'index'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('folders', nargs='+', metavar='[index] DIR',
                        help='folder of one replay; after "index" the folder above many (./index is a folder)')
    parser.add_argument('--truth', type=Path,
                        help='VisDrone annotation, KITTI labels, MOT Challenge gt.txt or CSV to compare with')
    parser.add_argument('--input', dest='source', metavar='IN', help='where the input is now (default: where it was)')
    parser.add_argument('-o', '--output', type=output_path, metavar='FILE',
                        help='default: report.html or index.html in DIR')


def run(arguments: argparse.Namespace) -> int:
    """Make the page and print where it is. Raises: MotionDetectError, OSError."""
    *words, folder = arguments.folders
    if words not in ([], [INDEX]) or (not words and folder == INDEX):
        raise SourceError(f'report: expected DIR or index DIR, got {" ".join(arguments.folders)}')
    if words and (arguments.truth or arguments.source):
        raise SourceError('report index: expected neither --truth nor --input')
    if words:
        print(make_index(Path(folder), arguments.output))
    else:
        if arguments.source:
            _check_input(Path(folder), arguments.source)
        print(make_report(Path(folder), arguments.truth, arguments.output, arguments.source))
    return 0


def _check_input(folder: Path, source: str) -> None:
    """Raises: SourceError for one that is not there, or not of the size of what was replayed."""
    if not Path(source).exists():
        raise SourceError(f'--input: {source}: no such file or folder')
    was, now = read_summary(folder).input_bytes, size_of(source)
    if was is not None and now is not None and was != now:
        raise SourceError(f'--input: expected the recording that was replayed, {was} bytes, got {source}, {now} bytes')
