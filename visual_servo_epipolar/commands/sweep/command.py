"""``visual_servo sweep``: many starts through the closed loop, here or on a cluster."""

import argparse
from typing import Any

from visual_servo_epipolar.commands.arguments import (
    add_run_options,
    add_source,
    law_expression,
    seed,
)
from visual_servo_epipolar.simulation.choices import REGIONS

DEFAULT_FOLDER = 'sweep_out'
MAX_RUNS, MAX_SCENES = 1_000_000, 10_000


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'sweep',
        help='many starts through the closed loop: arrivals, errors, maps',
        description=__doc__,
        epilog='Runs are kept in DIR as they end. The same command, given again after it was '
        'interrupted or killed, goes on where it was; with more --runs it adds to them.',
    )
    parser.add_argument('--region', choices=REGIONS, required=True, help='where to start')
    parser.add_argument(
        '--runs', type=count, required=True, metavar='N', help='starts, for each law'
    )
    add_source(parser)
    add_run_options(parser)
    parser.add_argument(
        '--compare', type=laws, metavar='LAW,LAW', help='several laws from the same starts'
    )
    parser.add_argument(
        '--scenes', type=scenes, metavar='N-M', help='rooms to take turns in, such as 101-110'
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--jobs', type=count, metavar='J', help='worker processes (default one a core)'
    )
    where.add_argument(
        '--scheduler', metavar='ADDRESS', help='Dask scheduler to use, such as tcp://host:8786'
    )
    parser.add_argument(
        '--out',
        metavar='DIR',
        help=f'folder for runs, table and maps (default {DEFAULT_FOLDER}/ and a name made of '
        'the parameters)',
    )
    parser.set_defaults(run=run)


def count(text: str) -> int:
    """Parse a number of runs or of processes."""
    if not text.isdecimal() or not 1 <= int(text) <= MAX_RUNS:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 1 to {MAX_RUNS}')
    return int(text)


def laws(text: str) -> tuple[str, ...]:
    """Parse a list of laws, each once."""
    names = tuple(law_expression(name) for name in text.split(','))
    if len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f'{text!r} must list each law once')
    return names


def scenes(text: str) -> tuple[int, ...]:
    """Parse seeds of rooms: single ones and ranges, with commas between."""
    seeds: list[int] = []
    for part in text.split(','):
        first, dash, last = part.partition('-')
        ends = seed(first), seed(last if dash else first)
        if not 0 <= ends[1] - ends[0] < MAX_SCENES:
            raise argparse.ArgumentTypeError(f'{part!r} is not a range of up to {MAX_SCENES}')
        seeds += range(ends[0], ends[1] + 1)
    return tuple(seeds)


def run(options: argparse.Namespace) -> int:
    """Run what is missing, draw, write, print; return 0 unless a run raised."""
    from visual_servo_epipolar.commands.sweep.run import sweep

    return sweep(options)
