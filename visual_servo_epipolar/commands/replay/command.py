"""``visual_servo replay``: a bag through the same tracker and servo, with any parameters."""

import argparse
from typing import Any

from visual_servo_epipolar.commands.arguments import CAMERA_HELP, CROPPED_HELP, finite

BAG_KINDS = 'rosbag2 folder, .mcap, .db3, or ROS 1 .bag'
ROLES = (
    'image, camera_info, desired, tracks, cmd_vel, epipoles, diagnostics, ground_truth, '
    'tracker_settings, servo_settings, tracker_events, servo_events'
)


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'replay',
        help='a bag through the same tracker and servo',
        description='A bag through the same tracker and servo, with any parameters; tells where '
        'its commands differ from those recorded.',
    )
    add_bag_options(parser)
    parser.add_argument(
        '--out', metavar='DIR', help='folder for replay.json and a figure of both runs'
    )
    parser.add_argument(
        '--tolerance',
        type=_tolerance,
        metavar='T',
        help='how far numbers may differ, in their units and relative above 1 (default 0 where '
        'the servo was recorded, otherwise any)',
    )
    parser.add_argument(
        '--json', metavar='FILE', help='write the result as JSON to FILE, - for standard output'
    )
    parser.set_defaults(run=run)


def add_bag_options(
    parser: argparse.ArgumentParser, *, metavar: str = 'BAG', text: str = BAG_KINDS
) -> None:
    """Add the options of a bag: which, and how to read and replay it."""
    parser.add_argument('bag', metavar=metavar, help=text)
    parser.add_argument(
        '--set',
        nargs='+',
        action='extend',
        default=[],
        metavar='SECTION.NAME=VALUE',
        help='replay with other settings, such as servo.k1=0.1 or tracker.max_features=80',
    )
    parser.add_argument('--params', metavar='FILE', help='such settings from a ROS parameter file')
    parser.add_argument(
        '--topics',
        nargs='+',
        action='extend',
        default=[],
        metavar='ROLE=NAME',
        help=f'topics of other names; roles: {ROLES}',
    )
    parser.add_argument(
        '--namespace',
        metavar='NAME',
        help='robot whose topics are read, such as /bot1, where the bag has several',
    )
    parser.add_argument(
        '--desired',
        metavar='FILE|STAMP',
        help='photograph of the goal: an image file, or the stamp [s] of an image in the bag; '
        '+S counts from the first one',
    )
    parser.add_argument(
        '--camera', metavar='FILE', help=f'for a bag without camera_info: {CAMERA_HELP}'
    )
    parser.add_argument('--cropped', action='store_true', help=CROPPED_HELP)
    parser.add_argument(
        '--rectified',
        action='store_true',
        help='the images are rectified: P of camera_info holds, the distortion does not; known of '
        'a bag that has the settings of the nodes',
    )
    parser.add_argument(
        '--tracks', action='store_true', help='replay the recorded tracks instead of the images'
    )
    parser.add_argument(
        '--repair',
        action='store_true',
        help='first complete a bag that is damaged, or that a crash left open: all that can be '
        'read is kept, and the old file as NAME.damaged',
    )


def run(options: argparse.Namespace) -> int:
    """Replay, print, write; return 0 if nothing differs from what was recorded."""
    from visual_servo_epipolar.commands.replay.run import replay_and_report

    return 0 if replay_and_report(options) else 1


def _tolerance(text: str) -> float:
    value = finite(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is negative')
    return value
