"""Report: an HTML page on a run, a bag or a route."""

import argparse
from pathlib import Path

from visual_servo_epipolar.commands.files.output import OutputFolder
from visual_servo_epipolar.commands.report.bag import report_bag
from visual_servo_epipolar.commands.report.route import report_route
from visual_servo_epipolar.commands.report.run import report_run
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import made_folder
from visual_servo_epipolar.messages.routes.route_folder import is_route
from visual_servo_epipolar.report.page import FILE
from visual_servo_epipolar.report.run_file import FILE as RUN_FILE


def report(options: argparse.Namespace) -> int:
    """Write the page; return 0 when it is there, whatever became of the run."""
    source = Path(options.bag)
    if source.name == RUN_FILE and source.is_file():
        source = source.parent
    is_run, is_taught = (source / RUN_FILE).is_file(), is_route(source)
    folder = Path(options.out or _default_folder(source, is_run))
    OutputFolder(folder).check()
    if is_run or is_taught:
        _refuse_bag_options(options)
    with made_folder(folder):
        if is_run:
            report_run(source, folder / FILE)
        elif is_taught:
            report_route(source, folder / FILE)
        else:
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
            f'{options.bag} is no bag: {", ".join(given)} cannot change what is in it; '
            'leave them out, or report on a bag'
        )
