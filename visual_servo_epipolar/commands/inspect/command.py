"""``visual_servo inspect``: two photographs, their epipoles, and whether to believe them."""

import argparse
from typing import Any

from visual_servo_epipolar.commands.arguments import CAMERA_HELP, CROPPED_HELP


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'inspect', help='two photographs: epipoles, bearings, trust', description=__doc__
    )
    parser.add_argument('desired', metavar='DESIRED.png', help='photograph taken at the goal')
    parser.add_argument('current', metavar='CURRENT.png', help='photograph taken elsewhere')
    parser.add_argument(
        '--camera',
        metavar='FILE',
        required=True,
        help=f'{CAMERA_HELP}; scaled to photographs of other size',
    )
    parser.add_argument(
        '--rectified',
        action='store_true',
        help='the photographs are rectified: projection_matrix holds, the distortion does not',
    )
    parser.add_argument('--cropped', action='store_true', help=CROPPED_HELP)
    parser.add_argument('--out', metavar='OVERLAY.png', help='picture of the matches')
    parser.add_argument('--estimator', metavar='NAME', help='estimator of the epipoles')
    parser.add_argument(
        '--json', metavar='FILE', help='write the result as JSON to FILE, - for standard output'
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Inspect, write, print; return 0 if the result can be trusted."""
    from visual_servo_epipolar.commands.inspect.run import inspect_and_report

    return inspect_and_report(options)
