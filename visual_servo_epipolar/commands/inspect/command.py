"""``visual_servo inspect``: two photographs, their epipoles, and whether to believe them."""

import argparse
import math
from typing import Any

from visual_servo_epipolar.commands.arguments import CAMERA_HELP, CROPPED_HELP

MOUNT_DEVIATION = 1.0  # of a tilt and roll that are told [deg]


def angle(text: str) -> float:
    """Return an angle [deg], or raise what argparse turns into a message."""
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not abs(degrees) <= 90.0:
        raise argparse.ArgumentTypeError(f'{text!r} is no angle of -90 to 90 deg')
    return degrees


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
    _add_mount(parser)
    parser.add_argument(
        '--json', metavar='FILE', help='write the result as JSON to FILE, - for standard output'
    )
    parser.set_defaults(run=run)


def _add_mount(parser: argparse.ArgumentParser) -> None:
    """Add how the camera is mounted."""
    for name, what in (
        (
            'tilt',
            'camera, down positive; without it tilt and roll are estimated, and general motions '
            'are given in axes of the cameras',
        ),
        ('roll', 'camera, clockwise; with --tilt alone it is zero'),
        ('yaw', 'camera on the base, to the left: bearings are then those of the base'),
    ):
        parser.add_argument(
            f'--{name}', type=angle, metavar='DEG', help=f'{name} of the {what} [deg]'
        )
    parser.add_argument(
        '--mount-deviation',
        type=angle,
        metavar='DEG',
        default=MOUNT_DEVIATION,
        help=f'how well tilt and roll are known (default {MOUNT_DEVIATION:g} deg)',
    )


def run(options: argparse.Namespace) -> int:
    """Inspect, write, print; return 0 if the result can be trusted."""
    from visual_servo_epipolar.commands.inspect.run import inspect_and_report

    return inspect_and_report(options)
