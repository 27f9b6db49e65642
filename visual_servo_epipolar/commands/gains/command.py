"""
``visual_servo gains``: the gains of section IV-C from what is known before the robot moves.

A table of the gains and of what they promise, and lines to paste into the file of servo_node. A
warning where they need longer than a phase of the servo may last.
"""

import argparse
from dataclasses import fields
from typing import Any

from visual_servo_epipolar.commands.arguments import finite
from visual_servo_epipolar.core.laws.gains import Circumstances
from visual_servo_epipolar.core.settings import range_of

# As the settings of the servo have it, which take four times as long to load as all of this.
PHASE_TIMEOUT, PHASE_TIMEOUT_HELP = 120.0, 'Longest stay in one phase [s], 1 to 3600 (default 120)'


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'gains', help='gains derived from distance, rate and limits', description=__doc__
    )
    for item in fields(Circumstances):
        limits, option = range_of(item), f'--{item.name.replace("_", "-")}'
        if isinstance(item.default, bool):
            parser.add_argument(option, action='store_true', help=limits.text)
            continue
        parser.add_argument(
            option,
            type=finite,
            default=item.default,
            metavar=item.name.upper(),
            help=f'{limits.text}, {limits.low:g} to {limits.high:g} (default {item.default:g})',
        )
    parser.add_argument(
        '--phase-timeout',
        type=finite,
        default=PHASE_TIMEOUT,
        metavar='PHASE_TIMEOUT',
        help=PHASE_TIMEOUT_HELP,
    )
    parser.add_argument(
        '--json', metavar='FILE', help='write the result as JSON to FILE, - for standard output'
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Derive, write, print; return 0. InputError where no gain is legal."""
    from visual_servo_epipolar.commands.gains.run import derive_and_print

    return derive_and_print(options)
