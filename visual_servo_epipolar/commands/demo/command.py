"""``visual_servo demo``: the four real nodes in lockstep; leaves result, figures, video, bag."""

import argparse
from typing import Any

from visual_servo_epipolar.commands.arguments import add_run_options, add_start

DEFAULT_START = (1.0, -3.5, 8.0)
DEFAULT_FOLDER = 'demo_out'
# What a bag leaves out. Images have 1.3 MB each; a bag without them is replayed from tracks.
EXCLUDED = {'tracks': ('*image_raw',), 'images': ('*overlay/image_raw',)}


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'demo', help='the four real nodes in lockstep, with pictures', description=__doc__
    )
    add_start(parser, DEFAULT_START)
    parser.add_argument(
        '--out',
        metavar='DIR',
        default=DEFAULT_FOLDER,
        help=f'folder for result.json, figures, video and bag (default {DEFAULT_FOLDER})',
    )
    parser.add_argument('--no-video', action='store_true', help='leave out the video')
    parser.add_argument(
        '--bag',
        choices=('none', *EXCLUDED),
        default='tracks',
        help='what to record: tracks is everything but images, images is both, 400 MB '
        '(default tracks)',
    )
    parser.add_argument(
        '--visible',
        action='store_true',
        help='let other processes on this machine see the topics; any base driver that listens '
        'to cmd_vel will then drive',
    )
    add_run_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run, write, print; return 0 if the robot arrived."""
    from visual_servo_epipolar.commands.demo.run import demo

    return demo(options)
