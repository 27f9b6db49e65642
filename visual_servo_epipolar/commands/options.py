"""Options of the commands of the product; loads no library."""

from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import fields
import os

from visual_servo_epipolar.commands.arguments import (
    add_choice,
    add_flags,
    add_json,
    add_lists,
    add_out,
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
from visual_servo_epipolar.commands.outputs import OutputFile
from visual_servo_epipolar.core.laws.circumstances import Circumstances
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.simulation.choices import REGIONS, WAYS, WORLDS

# What a bag leaves out. Images have 1.3 MB each; a bag without them is replayed from tracks.
EXCLUDED = {'tracks': ('*image_raw',), 'images': ('*overlay/image_raw',), 'none': ('*',)}
CAMERA = (
    'camera file of camera_calibration, OpenCV or Kalibr, or a camera_info '
    'as printed by ros2 topic echo; FILE#cam1 picks one of several cameras'
)
BAG = 'rosbag2 folder, .mcap or .db3'
TOPICS = 'names of topics by role'
CROPPED = {'--cropped': 'images are crops: accept a principal point anywhere'}
ROLES = (
    'image, camera_info, desired, tracks, cmd_vel, epipoles, diagnostics, ground_truth, '
    'tracker_settings, servo_settings, tracker_events, servo_events'
)


def add_demo(parser: ArgumentParser) -> None:
    """Add the options of ``demo``."""
    add_start(parser, 1.0, -3.5, 8.0)
    add_out(parser, 'folder for result.json, figures, video and bag', 'demo_out')
    text = 'what the bag holds: all topics but images, images as well, 250 MB, or nothing'
    add_choice(parser, '--bag', [*EXCLUDED], text)
    add_flags(parser, {'--no-video': 'make no video'})
    add_run_options(parser)


def add_simulate(parser: ArgumentParser) -> None:
    """Add the options of ``simulate``."""
    add_start(parser)
    add_source(parser)
    add_out(parser, 'folder for result, samples and figures')
    add_run_options(parser)


def add_sweep(parser: ArgumentParser) -> None:
    """Add the options of ``sweep``."""
    parser.epilog = (
        'Each run is kept in DIR as soon as it ends. After an interruption the same command '
        'goes on from there; with a larger --runs it adds runs.'
    )
    text = 'start in front of the goal, beside it, anywhere in view, or around it in view'
    parser.add_argument('--region', choices=REGIONS, required=True, help=text)
    add_words(parser, {'--runs N': 'number of starts for each law'}, type=count, required=True)
    add_source(parser)
    add_run_options(parser)
    add_words(parser, {'--compare LAW,LAW': 'drive several laws from the same starts'}, type=laws)
    add_words(parser, {'--scenes N-M': 'use these rooms in turn, such as 101-110'}, type=scenes)
    where = parser.add_mutually_exclusive_group()
    add_words(where, {'--jobs J': 'worker processes (default one per core)'}, type=count)
    add_words(where, {'--scheduler ADDRESS': 'Dask scheduler, such as tcp://host:8786'})
    add_out(parser, 'folder for runs, tables and maps (default a new one in sweep_out/)')


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
    # As the tracker's parameters of these names have it.
    add_words(parser, {'--matcher NAME': 'matcher'}, default='sift')
    model = 'ONNX file of keypoints and descriptors, for --matcher onnx'
    add_words(parser, {'--matcher-model FILE.onnx': model}, default='')
    angles = {
        '--tilt DEG': 'tilt of the camera [deg], down positive; without it tilt and roll are '
        'estimated, and a motion that is not planar is given in camera axes',
        '--roll DEG': 'roll of the camera [deg], clockwise; 0 if only --tilt is given',
    }
    add_words(parser, angles, type=angle)
    deviation = {'--mount-deviation DEG': 'standard deviation of tilt and roll [deg]'}
    add_words(parser, deviation, type=angle, default=1.0)
    add_json(parser)


def add_gains(parser: ArgumentParser) -> None:
    """Add the options of ``gains``."""
    for item in fields(Circumstances):
        limits, option = range_of(item), f'--{item.name.replace("_", "-")}'
        if isinstance(item.default, bool):
            add_flags(parser, {option: limits.text})
            continue
        words = {
            f'{option} {item.name.upper()}': f'{limits.text}, {limits.low:g} to {limits.high:g}'
        }
        add_words(parser, words, type=finite, default=item.default)
    timeout = 'longest stay in one phase [s] (default that of the servo)'
    add_words(parser, {'--phase-timeout PHASE_TIMEOUT': timeout}, type=finite)
    add_json(parser)


def add_replay(parser: ArgumentParser) -> None:
    """Add the options of ``replay``."""
    _add_bag(parser, 'BAG', BAG)
    add_out(parser, 'folder for replay.json and a figure of both runs')
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
    place = 'the folder of the run, or NAME_report beside bag NAME'
    add_out(parser, f'folder for report.html (default {place})')


def add_route(parser: ArgumentParser) -> None:
    """Add the actions of ``route``."""
    actions = parser.add_subparsers(dest='action', required=True, metavar='ACTION')
    words = {
        'teach': 'learn a route from a bag with images, camera_info and odom',
        'demo': 'teach a way in a simulated storey, repeat it, and judge by ground truth',
    }
    teach, demo = (
        actions.add_parser(name, help=text, description=f'{text.capitalize()}.')
        for name, text in words.items()
    )
    _add_path(teach, 'bag', 'BAG', BAG)
    add_lists(teach, {'--topics ROLE=NAME': f'{TOPICS}: image, camera_info, cmd_vel'})
    add_out(teach, 'folder of the route (default BAG_route)')
    cameras = teach.add_mutually_exclusive_group()
    add_words(cameras, {'--camera FILE': f'use this instead of camera_info: {CAMERA}'})
    projection = 'camera of 360 deg without camera_info, such as equirectangular'
    add_words(cameras, {'--projection NAME': projection}, default='camera_info')
    odometry = 'topic of the odometry (default: the one of that type)'
    add_words(teach, {'--odometry NAME': odometry}, default='')
    parts = 'also write the parts of a way that is interrupted, as DIR_2, DIR_3 ...'
    add_flags(teach, {'--rectified': 'images are rectified: use P of camera_info', **CROPPED})
    add_flags(teach, {'--parts': parts})
    add_json(teach)
    _add_route_demo(demo)


def _add_route_demo(demo: ArgumentParser) -> None:
    add_choice(demo, '--way', WAYS, 'the way through the storey')
    add_words(demo, {'--runs N': 'repetitions'}, type=count, default=1)
    laps = 'laps per repetition, for a route that closes'
    add_words(demo, {'--laps N': laps}, type=_number_of('laps'), default=1)
    add_words(demo, {'--kidnaps N': 'starts beside the route'}, type=count, default=20)
    elsewhere = {'--elsewhere N': 'starts anywhere in another storey'}
    add_words(demo, elsewhere, type=count_or_none, default=0)
    text = (
        "what has changed at the repetition, drawn by each run's seed: lamps, windows, tones, a "
        'third of the pictures and of the furniture, people who walk by'
    )
    add_choice(demo, '--world', WORLDS, text)
    renew = 'photographs of other light that a key view keeps, from arrivals'
    add_words(demo, {'--renewals N': renew}, type=_number_of('renewals'), default=0)
    add_flags(demo, {'--reverse': 'repeat it backward, from the last station to the first'})
    add_out(demo, 'folder for the route and result.json', 'route_out')
    add_run_options(demo)


def _number_of(name: str) -> Callable[[str], int]:
    """Return what parses a whole number in the range that the route_node has for it."""
    limits = range_of(FollowSettings.__dataclass_fields__[name])
    return whole(int(limits.low or 0), int(limits.high or 0))


def _add_path(parser: ArgumentParser, name: str, metavar: str, text: str) -> None:
    parser.add_argument(name, metavar=metavar, help=text, type=os.path.expanduser)


def _add_bag(parser: ArgumentParser, metavar: str, kinds: str) -> None:
    _add_path(parser, 'bag', metavar, kinds)
    lists = {
        '--set SECTION.NAME=VALUE': 'replay with other settings, such as servo.k1=0.1 or '
        'tracker.max_features=80',
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


# What each does, and what adds its options; ``run`` of the module of that name runs it.
COMMANDS: dict[str, tuple[str, Callable[[ArgumentParser], None]]] = {
    'demo': ('drive home with the four real nodes, in lockstep', add_demo),
    'simulate': ('simulate one run in memory, without ROS', add_simulate),
    'sweep': ('simulate many starts, here or on a cluster; write tables and maps', add_sweep),
    'inspect': (
        'find the epipoles of two photographs, and tell whether they can be trusted',
        add_inspect,
    ),
    'replay': (
        'replay a bag, with the same or other settings, and compare with what was recorded',
        add_replay,
    ),
    'report': ('write one HTML page on a run or a bag', add_report),
    'route': ('learn a way from a drive, and repeat it by photographs', add_route),
    'gains': (
        'derive gains from distance, image rate and speed limits; warn of slow phases',
        add_gains,
    ),
}
