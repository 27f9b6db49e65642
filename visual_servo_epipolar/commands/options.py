"""Options of the commands of the product, and which function runs each; loads no library."""

from argparse import ArgumentParser
from collections.abc import Callable, Mapping
from dataclasses import fields
import os
from typing import NamedTuple

from visual_servo_epipolar.commands.arguments import (
    add_flags,
    add_json,
    add_lists,
    add_run_options,
    add_source,
    add_start,
    add_words,
    angle,
    count,
    count_or_none,
    finite,
    laws,
    scenes,
    tolerance,
    whole,
)
from visual_servo_epipolar.commands.outputs import OutputFile, OutputFolder
from visual_servo_epipolar.core.laws.circumstances import Circumstances
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.simulation.choices import REGIONS, WAYS, WORLDS

DEMO_START = (1.0, -3.5, 8.0)
DEMO_FOLDER, SWEEP_FOLDER, ROUTE_FOLDER = 'demo_out', 'sweep_out', 'route_out'
# What a bag leaves out. Images have 1.3 MB each; a bag without them is replayed from tracks.
EXCLUDED = {'tracks': ('*image_raw',), 'images': ('*overlay/image_raw',)}
MOUNT_DEVIATION = 1.0  # of a tilt and roll that are given [deg]
# As the settings of the servo have it, which take four times as long to load as all of this.
PHASE_TIMEOUT, PHASE_TIMEOUT_HELP = 120.0, 'Longest stay in one phase [s], 1 to 3600 (default 120)'
CAMERA = (
    'camera file of camera_calibration, OpenCV or Kalibr, or a camera_info '
    'as printed by ros2 topic echo; FILE#cam1 picks one of several cameras'
)
BAG = 'rosbag2 folder, .mcap or .db3'
SET, TOPICS = 'replay with other settings, such as', 'names of topics by role'
ACTIONS = {  # of routes
    'teach': 'learn a route from a bag with images, camera_info and odom',
    'demo': 'teach a way in a simulated storey, repeat it, and judge by ground truth',
}
CROPPED = {'--cropped': 'images are crops: accept a principal point anywhere'}
ROLES = (
    'image, camera_info, desired, tracks, cmd_vel, epipoles, diagnostics, ground_truth, '
    'tracker_settings, servo_settings, tracker_events, servo_events'
)


def add_demo(parser: ArgumentParser) -> None:
    """Add the options of ``demo``."""
    add_start(parser, DEMO_START)
    folder = f'folder for result.json, figures, video and bag (default {DEMO_FOLDER})'
    add_words(parser, {'--out DIR': folder}, type=OutputFolder, default=DEMO_FOLDER)
    parser.add_argument(
        '--bag',
        choices=('none', *EXCLUDED),
        default='tracks',
        help='what the bag holds: nothing, all topics but images, or images as well, which take '
        '250 MB (default tracks)',
    )
    add_flags(parser, {'--no-video': 'make no video'})
    add_run_options(parser)


def add_simulate(parser: ArgumentParser) -> None:
    """Add the options of ``simulate``."""
    add_start(parser, None)
    add_source(parser)
    out = {'--out DIR': 'folder for result, samples and figures'}
    add_words(parser, out, type=OutputFolder)
    add_run_options(parser)


def add_sweep(parser: ArgumentParser) -> None:
    """Add the options of ``sweep``."""
    parser.epilog = (
        'Each run is kept in DIR as soon as it ends. After an interruption the same command '
        'goes on from there; with a larger --runs it adds runs.'
    )
    parser.add_argument(
        '--region',
        choices=REGIONS,
        required=True,
        help='start in front of the goal, beside it, anywhere in view, or around it in view',
    )
    add_words(parser, {'--runs N': 'number of starts for each law'}, type=count, required=True)
    add_source(parser)
    add_run_options(parser)
    add_words(parser, {'--compare LAW,LAW': 'drive several laws from the same starts'}, type=laws)
    add_words(parser, {'--scenes N-M': 'use these rooms in turn, such as 101-110'}, type=scenes)
    where = parser.add_mutually_exclusive_group()
    add_words(where, {'--jobs J': 'worker processes (default one per core)'}, type=count)
    add_words(where, {'--scheduler ADDRESS': 'Dask scheduler, such as tcp://host:8786'})
    folder = f'folder for runs, tables and maps (default a new one in {SWEEP_FOLDER}/)'
    add_words(parser, {'--out DIR': folder}, type=OutputFolder)


def add_inspect(parser: ArgumentParser) -> None:
    """Add the options of ``inspect``."""
    _add_path(parser, 'desired', 'DESIRED.png', 'photograph taken at the goal')
    _add_path(parser, 'current', 'CURRENT.png', 'photograph taken elsewhere')
    camera = f'{CAMERA}; it is scaled to the size of the photographs'
    add_words(parser, {'--camera FILE': camera}, required=True)
    rectified = 'photographs are rectified: use projection_matrix, ignore the distortion'
    add_flags(parser, {'--rectified': rectified, **CROPPED})
    overlay = {'--out OVERLAY.png': 'write a picture of the matches'}
    add_words(parser, overlay, type=OutputFile)
    add_words(parser, {'--estimator NAME': 'estimator of the epipoles'})
    add_matcher(parser)
    angles = {
        '--tilt DEG': 'tilt of the camera [deg], down positive; without it tilt and roll are '
        'estimated, and a motion that is not planar is given in camera axes',
        '--roll DEG': 'roll of the camera [deg], clockwise; 0 if only --tilt is given',
    }
    add_words(parser, angles, type=angle)
    known = f'standard deviation of tilt and roll [deg] (default {MOUNT_DEVIATION:g})'
    add_words(parser, {'--mount-deviation DEG': known}, type=angle, default=MOUNT_DEVIATION)
    add_json(parser)


def add_matcher(parser: ArgumentParser) -> None:
    """Add how photographs are matched, as the tracker's parameters of these names say it."""
    add_words(parser, {'--matcher NAME': 'matcher (default sift)'}, default='sift')
    model = 'ONNX file of keypoints and descriptors, for --matcher onnx'
    add_words(parser, {'--matcher-model FILE.onnx': model}, default='')


def add_gains(parser: ArgumentParser) -> None:
    """Add the options of ``gains``."""
    for item in fields(Circumstances):
        limits, option = range_of(item), f'--{item.name.replace("_", "-")}'
        if isinstance(item.default, bool):
            add_flags(parser, {option: limits.text})
            continue
        text = f'{limits.text}, {limits.low:g} to {limits.high:g} (default {item.default:g})'
        add_words(
            parser, {f'{option} {item.name.upper()}': text}, type=finite, default=item.default
        )
    timeout = {'--phase-timeout PHASE_TIMEOUT': PHASE_TIMEOUT_HELP}
    add_words(parser, timeout, type=finite, default=PHASE_TIMEOUT)
    add_json(parser)


def add_replay(parser: ArgumentParser) -> None:
    """Add the options of ``replay``."""
    _add_bag(parser, 'BAG', BAG)
    out = {'--out DIR': 'folder for replay.json and a figure of both runs'}
    add_words(parser, out, type=OutputFolder)
    most = (
        'largest difference that counts as equal, in the unit of the number, relative above 1 '
        '(default 0 if telemetry of the servo was recorded, else any)'
    )
    add_words(parser, {'--tolerance T': most}, type=tolerance)
    add_json(parser)


def add_report(parser: ArgumentParser) -> None:
    """Add the options of ``report``."""
    what = '--out folder of demo or simulate, its run.json, or a bag'
    _add_bag(parser, 'RUN_OR_BAG', what)
    folder = (
        'folder for report.html (default the folder of the run, or NAME_report beside bag NAME)'
    )
    add_words(parser, {'--out DIR': folder}, type=OutputFolder)


def add_route(parser: ArgumentParser) -> None:
    """Add the actions of ``route``."""
    actions = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    teach, demo = (
        actions.add_parser(name, help=text, description=f'{text.capitalize()}.')
        for name, text in ACTIONS.items()
    )
    _add_path(teach, 'bag', 'BAG', BAG)
    add_lists(teach, {'--topics ROLE=NAME': f'{TOPICS}: image, camera_info, cmd_vel'})
    out = {'--out DIR': 'folder of the route (default BAG_route)'}
    add_words(teach, out, type=OutputFolder)
    cameras = teach.add_mutually_exclusive_group()
    add_words(cameras, {'--camera FILE': f'use this instead of camera_info: {CAMERA}'})
    projection = 'camera of 360 deg without camera_info, such as equirectangular'
    add_words(cameras, {'--projection NAME': projection}, default='camera_info')
    add_words(
        teach,
        {'--odometry NAME': 'topic of the odometry (default: the one of that type)'},
        default='',
    )
    parts = 'also write the parts of a way that is interrupted, as DIR_2, DIR_3 ...'
    add_flags(teach, {'--rectified': 'images are rectified: use P of camera_info', **CROPPED})
    add_flags(teach, {'--parts': parts})
    add_json(teach)
    _add_route_demo(demo)


def _add_route_demo(demo: ArgumentParser) -> None:
    demo.add_argument(
        '--way', choices=WAYS, default='short', help='the way through the storey (default short)'
    )
    add_words(demo, {'--runs N': 'repetitions (default 1)'}, type=count, default=1)
    laps = 'laps per repetition, for a route that closes (default 1)'
    add_words(demo, {'--laps N': laps}, type=_number_of('laps'), default=1)
    add_words(
        demo, {'--kidnaps N': 'starts beside the route (default 20)'}, type=count, default=20
    )
    add_words(
        demo,
        {'--elsewhere N': 'starts anywhere in another storey (default 0)'},
        type=count_or_none,
        default=0,
    )
    demo.add_argument(
        '--world',
        choices=WORLDS,
        default=WORLDS[0],
        help="what has changed at the repetition, drawn by each run's seed: lamps, windows, "
        'tones, a third of the pictures and of the furniture, people who walk by (default same)',
    )
    renew = 'photographs of other light that a key view keeps, from arrivals (default 0)'
    add_words(demo, {'--renewals N': renew}, type=_number_of('renewals'), default=0)
    add_flags(demo, {'--reverse': 'repeat it backward, from the last station to the first'})
    out = f'folder for the route and result.json (default {ROUTE_FOLDER})'
    add_words(demo, {'--out DIR': out}, type=OutputFolder, default=ROUTE_FOLDER)
    add_run_options(demo)


def _number_of(name: str) -> Callable[[str], int]:
    """Return what parses a whole number in the range that the route_node has for it."""
    limits = range_of(FollowSettings.__dataclass_fields__[name])
    assert limits.low is not None
    assert limits.high is not None
    return whole(int(limits.low), int(limits.high))


def _add_path(parser: ArgumentParser, name: str, metavar: str, text: str) -> None:
    parser.add_argument(name, metavar=metavar, help=text, type=os.path.expanduser)


def _add_bag(parser: ArgumentParser, metavar: str, kinds: str) -> None:
    _add_path(parser, 'bag', metavar, kinds)
    lists = {
        '--set SECTION.NAME=VALUE': f'{SET} servo.k1=0.1 or tracker.max_features=80',
        '--topics ROLE=NAME': f'{TOPICS}; roles are {ROLES}',
    }
    add_lists(parser, lists)
    words = {
        '--namespace NAME': 'robot to replay, such as /bot1, if the bag has several',
        '--desired FILE|STAMP': 'photograph of the goal: an image file, or the stamp [s] of an '
        'image in the bag; +S counts from the first image',
        '--camera FILE': f'use this instead of camera_info: {CAMERA}',
    }
    add_words(parser, words)
    flags = {
        **CROPPED,
        '--rectified': 'images are rectified: use P of camera_info, ignore the distortion; '
        'needless if the bag has the settings of the nodes',
        '--tracks': 'replay the recorded tracks, not the images',
        '--repair': 'repair a damaged or unfinished bag first; what can be read is written '
        'beside it',
    }
    add_flags(parser, flags)


class CommandRow(NamedTuple):
    """A command: what it does, its options, its function as module:name."""

    text: str
    add_options: Callable[[ArgumentParser], None]
    function: str


COMMANDS: Mapping[str, CommandRow] = {
    'demo': CommandRow('drive home with the four real nodes, in lockstep', add_demo, 'demo:demo'),
    'simulate': CommandRow(
        'simulate one run in memory, without ROS', add_simulate, 'simulate:simulate'
    ),
    'sweep': CommandRow(
        'simulate many starts, here or on a cluster; write tables and maps',
        add_sweep,
        'sweep:sweep',
    ),
    'inspect': CommandRow(
        'find the epipoles of two photographs, and tell whether they can be trusted',
        add_inspect,
        'inspect:inspect_and_report',
    ),
    'replay': CommandRow(
        'replay a bag, with the same or other settings, and compare with what was recorded',
        add_replay,
        'replay:replay_and_report',
    ),
    'report': CommandRow('write one HTML page on a run or a bag', add_report, 'report:report'),
    'route': CommandRow(
        'learn a way from a drive, and repeat it by photographs', add_route, 'route:route'
    ),
    'gains': CommandRow(
        'derive gains from distance, image rate and speed limits; warn of slow phases',
        add_gains,
        'gains:derive_and_print',
    ),
}
