"""Options of the commands of the product, and which function runs each; loads no library."""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

from visual_servo_epipolar.commands.arguments import (
    add_json,
    add_run_options,
    add_source,
    add_start,
    angle,
    CAMERA_HELP,
    count,
    CROPPED_HELP,
    finite,
    laws,
    scenes,
    tolerance,
)
from visual_servo_epipolar.core.laws.gains import Circumstances
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.simulation.choices import REGIONS

DEMO_START = (1.0, -3.5, 8.0)
DEMO_FOLDER, SWEEP_FOLDER = 'demo_out', 'sweep_out'
# What a bag leaves out. Images have 1.3 MB each; a bag without them is replayed from tracks.
EXCLUDED = {'tracks': ('*image_raw',), 'images': ('*overlay/image_raw',)}
MOUNT_DEVIATION = 1.0  # of a tilt and roll that are given [deg]
# As the settings of the servo have it, which take four times as long to load as all of this.
PHASE_TIMEOUT, PHASE_TIMEOUT_HELP = 120.0, 'Longest stay in one phase [s], 1 to 3600 (default 120)'
BAG_KINDS = 'rosbag2 folder, .mcap, .db3, or ROS 1 .bag'
ROLES = (
    'image, camera_info, desired, tracks, cmd_vel, epipoles, diagnostics, ground_truth, '
    'tracker_settings, servo_settings, tracker_events, servo_events'
)


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``demo``."""
    add_start(parser, DEMO_START)
    parser.add_argument(
        '--out',
        metavar='DIR',
        default=DEMO_FOLDER,
        help=f'folder for result.json, figures, video and bag (default {DEMO_FOLDER})',
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


def add_simulate(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``simulate``."""
    add_start(parser, None)
    add_source(parser)
    parser.add_argument('--out', metavar='DIR', help='folder for result, samples and figures')
    add_run_options(parser)


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``sweep``."""
    parser.epilog = (
        'Runs are kept in DIR as they end. The same command, given again after it was '
        'interrupted or killed, goes on where it was; with more --runs it adds to them.'
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
        help=f'folder for runs, table and maps (default {SWEEP_FOLDER}/ and a name made of '
        'the parameters)',
    )


def add_inspect(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``inspect``."""
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
    add_json(parser)


def add_gains(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``gains``."""
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
    add_json(parser)


def add_replay(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``replay``."""
    _add_bag(parser, 'BAG', BAG_KINDS)
    parser.add_argument(
        '--out', metavar='DIR', help='folder for replay.json and a figure of both runs'
    )
    parser.add_argument(
        '--tolerance',
        type=tolerance,
        metavar='T',
        help='how far numbers may differ, in their units and relative above 1 (default 0 where '
        'the servo was recorded, otherwise any)',
    )
    add_json(parser)


def add_report(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``report``."""
    kinds = '--out folder of demo or simulate, the run.json in it, or a bag'
    _add_bag(parser, 'RUN_OR_BAG', kinds)
    parser.add_argument(
        '--out',
        metavar='DIR',
        help='folder for report.html, made if need be (default: that of the run, or NAME_report '
        'beside a bag NAME)',
    )


def _add_bag(parser: argparse.ArgumentParser, metavar: str, kinds: str) -> None:
    """Add the options of a bag: which, and how to read and replay it."""
    parser.add_argument('bag', metavar=metavar, help=kinds)
    for option, example, text in (
        (
            '--set',
            'SECTION.NAME=VALUE',
            'replay with other settings, such as servo.k1=0.1 or tracker.max_features=80',
        ),
        ('--topics', 'ROLE=NAME', f'topics of other names; roles: {ROLES}'),
    ):
        parser.add_argument(
            option, nargs='+', action='extend', default=[], metavar=example, help=text
        )
    parser.add_argument('--params', metavar='FILE', help='such settings from a ROS parameter file')
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
    _add_flags(parser)


def _add_flags(parser: argparse.ArgumentParser) -> None:
    """Add how the images of a bag are to be taken, and what to do with the bag."""
    for option, text in (
        ('--cropped', CROPPED_HELP),
        (
            '--rectified',
            'the images are rectified: P of camera_info holds, the distortion does not; known of '
            'a bag that has the settings of the nodes',
        ),
        ('--tracks', 'replay the recorded tracks instead of the images'),
        (
            '--repair',
            'first complete a bag that is damaged, or that a crash left open: all that can be '
            'read is kept, and the old file as NAME.damaged',
        ),
    ):
        parser.add_argument(option, action='store_true', help=text)


@dataclass(frozen=True, slots=True)
class CommandRow:
    """A command: its line in the list, what it does, its options, its function as module:name."""

    summary: str
    description: str
    add_options: Callable[[argparse.ArgumentParser], None]
    function: str


COMMANDS: Mapping[str, CommandRow] = {
    'demo': CommandRow(
        'the four real nodes in lockstep, with pictures',
        'The four real nodes in lockstep; leaves result, figures, video, bag.',
        add_demo,
        'demo:demo',
    ),
    'simulate': CommandRow(
        'one closed loop in memory, without ROS',
        'One closed loop in memory, without ROS.',
        add_simulate,
        'simulate:simulate',
    ),
    'sweep': CommandRow(
        'many starts through the closed loop: arrivals, errors, maps',
        'Many starts through the closed loop, here or on a cluster.',
        add_sweep,
        'sweep:sweep',
    ),
    'inspect': CommandRow(
        'two photographs: epipoles, bearings, trust',
        'Two photographs, their epipoles, and whether to believe them.',
        add_inspect,
        'inspect:inspect_and_report',
    ),
    'replay': CommandRow(
        'a bag through the same tracker and servo',
        'A bag through the same tracker and servo, with any parameters; tells where its commands '
        'differ from those recorded.',
        add_replay,
        'replay.run:replay_and_report',
    ),
    'report': CommandRow(
        'a run or a bag as one HTML page',
        'A run or a bag as one HTML page that needs no network.',
        add_report,
        'report.run:report',
    ),
    'gains': CommandRow(
        'gains derived from distance, rate and limits',
        'The gains of section IV-C from what is known before the robot moves: a table of the '
        'gains and of what they promise, and lines to paste into the file of servo_node. Warns '
        'where they need longer than a phase of the servo may last.',
        add_gains,
        'gains:derive_and_print',
    ),
}
