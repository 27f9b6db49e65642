"""``visual_servo report``: a run or a bag as one HTML page that needs no network."""

import argparse
from pathlib import Path
from typing import Any

from visual_servo_epipolar.commands.replay.command import add_bag_options
from visual_servo_epipolar.commands.replay.outputs import output_folder_for
from visual_servo_epipolar.core.errors import InputError


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'report',
        help='a run or a bag as one HTML page',
        description='A run or a bag as one HTML page that needs no network.',
    )
    add_bag_options(
        parser,
        metavar='RUN_OR_BAG',
        text='--out folder of demo or simulate, the run.json in it, or a bag',
    )
    parser.add_argument(
        '--out',
        metavar='DIR',
        help='folder for report.html, made if need be (default: that of the run, or NAME_report '
        'beside a bag NAME)',
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the page; return 0 when it is there, whatever became of the run."""
    from visual_servo_epipolar.report.page import FILE
    from visual_servo_epipolar.report.run_file import FILE as RUN_FILE

    source = Path(options.bag)
    if source.name == RUN_FILE and source.is_file():
        source = source.parent
    is_run = (source / RUN_FILE).is_file()
    folder = _default_folder(source, is_run) if options.out is None else Path(options.out)
    if is_run:
        from visual_servo_epipolar.commands.report.run import report_run

        _refuse_bag_options(options)
        with output_folder_for(folder):
            report_run(source, folder / FILE)
    else:
        from visual_servo_epipolar.commands.report.bag import report_bag

        with output_folder_for(folder):
            report_bag(options, folder / FILE)
    print(f'written: {folder / FILE}')
    return 0


def _default_folder(source: Path, is_run: bool) -> Path:
    """Return where the page goes: not into a bag, which is no place for other files."""
    if is_run:
        return source
    named = source if source.name not in ('', '..') else source.resolve()
    return named.with_name(f'{named.stem if named.is_file() else named.name}_report')


def _refuse_bag_options(options: argparse.Namespace) -> None:
    names = ('set', 'params', 'topics', 'namespace', 'desired', 'camera', 'tracks', 'repair')
    given = [f'--{name}' for name in names if getattr(options, name)]
    if given:
        raise InputError(
            f'{options.bag} is a run, not a bag: {", ".join(given)} cannot change what it did; '
            'leave out, or report on its bag'
        )
