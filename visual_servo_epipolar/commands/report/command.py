"""``visual_servo report``: a run or a bag as one HTML page that needs no network."""

import argparse
from pathlib import Path
from typing import Any

from visual_servo_epipolar.commands.arguments import output_folder
from visual_servo_epipolar.commands.replay.command import add_bag_options, NO_ROSBAGS
from visual_servo_epipolar.core.errors import InputError


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'report', help='a run or a bag as one HTML page', description=__doc__
    )
    add_bag_options(
        parser, metavar='RUN_OR_BAG', text='--out folder of demo or simulate, or a bag'
    )
    parser.add_argument(
        '--out', metavar='DIR', required=True, help='folder for report.html, made if need be'
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the page; return 0 when it is there, whatever became of the run."""
    from visual_servo_epipolar.report.page import FILE
    from visual_servo_epipolar.report.run_file import FILE as RUN_FILE

    source, path = Path(options.bag), Path(options.out) / FILE
    if (source / RUN_FILE).is_file():
        from visual_servo_epipolar.commands.report.run import report_run

        _refuse_bag_options(options)
        output_folder(options.out)
        report_run(source, path)
    else:
        try:
            from visual_servo_epipolar.commands.report.bag import report_bag
        except ImportError as error:
            raise InputError(NO_ROSBAGS.format(error)) from None
        report_bag(options, lambda: Path(output_folder(options.out), FILE))
    print(f'written: {path}')
    return 0


def _refuse_bag_options(options: argparse.Namespace) -> None:
    names = ('set', 'params', 'topics', 'desired', 'camera', 'tracks', 'repair')
    given = [f'--{name}' for name in names if getattr(options, name)]
    if given:
        raise InputError(
            f'{options.bag} is a run, not a bag: {", ".join(given)} cannot change what it did; '
            'leave out, or report on its bag'
        )
