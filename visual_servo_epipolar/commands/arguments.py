"""Arguments and outputs shared by subcommands."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
import json
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from visual_servo_epipolar.commands.files.output import check_json, write_whole
from visual_servo_epipolar.commands.files.resources import scenario_path
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.registry import law_options, LAWS
from visual_servo_epipolar.simulation.choices import SOURCES

if TYPE_CHECKING:
    from visual_servo_epipolar.simulation.scenario import Scenario

MAX_SEED = 2**31 - 1
FARTHEST, FULL_TURN = 100.0, 360.0  # start [m], [deg]: nothing drives home from farther
CAMERA_HELP = (
    'camera file of camera_calibration, OpenCV, Kalibr, COLMAP or nerfstudio, or a camera_info '
    'as ros2 topic echo prints it; FILE#cam1 where it has several cameras'
)
CROPPED_HELP = 'the images are cut out of larger ones: the principal point may lie anywhere'


def finite(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number') from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not finite')
    return value


def duration(text: str) -> float:
    """Parse a time above zero [s]."""
    value = finite(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is no time above 0 s')
    return value


def seed(text: str) -> int:
    """Parse a seed."""
    if not text.isdecimal() or int(text) > MAX_SEED:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 0 to {MAX_SEED}')
    return int(text)


def law_expression(text: str) -> str:
    """Parse the expression that names a law."""
    try:
        law_options(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


class Start(argparse.Action):
    """Take a start that lies where a robot may be."""

    def __call__(self, parser: Any, namespace: Any, values: Any, *_: object) -> None:
        """Keep x [m], y [m], heading error [deg]; ArgumentError if they are too large."""
        x, y, heading = values
        if max(abs(x), abs(y)) > FARTHEST or abs(heading) > FULL_TURN:
            raise argparse.ArgumentError(
                self,
                f'x and y must lie within {FARTHEST:g} m and the heading within {FULL_TURN:g} deg '
                f'of the goal, got {x:g} {y:g} {heading:g}',
            )
        setattr(namespace, self.dest, values)


def add_start(parser: argparse.ArgumentParser, default: tuple[float, float, float] | None) -> None:
    """Add --start."""
    default_text = '' if default is None else f' (default {" ".join(f"{v:g}" for v in default)})'
    parser.add_argument(
        '--start',
        nargs=3,
        action=Start,
        type=finite,
        metavar=('X', 'Y', 'DEG'),
        required=default is None,
        default=default,
        help='start in the plane of the paper: x right and y ahead of the goal [m], so that '
        f'y is negative behind it; heading error [deg], left positive{default_text}',
    )


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add --source."""
    parser.add_argument(
        '--source',
        choices=SOURCES,
        default='features',
        help='what the servo sees: noisy point features, or rendered images (default features)',
    )


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add what every closed loop takes: law, estimator, scenario, scene, seed, --json."""
    parser.add_argument(
        '--law',
        type=law_expression,
        metavar='LAW',
        help=f'control law: {", ".join(LAWS)}; departures from the paper are added and left out '
        'as in paper+true_sigma or full-retreat',
    )
    parser.add_argument('--estimator', metavar='NAME', help='estimator of the epipoles')
    parser.add_argument(
        '--scenario', metavar='FILE', help='scenario file, or the name of one that is installed'
    )
    parser.add_argument(
        '--scene', type=seed, metavar='N', help='seed of the room in images (default 1)'
    )
    parser.add_argument('--seed', type=seed, default=0, metavar='N', help='seed (default 0)')
    parser.add_argument(
        '--json', metavar='FILE', help='write the result as JSON to FILE, - for standard output'
    )


def scenario_of(options: argparse.Namespace) -> 'Scenario':
    """Return the scenario that the options ask for."""
    from visual_servo_epipolar.simulation.scenario import load, Scenario

    scenario = Scenario() if options.scenario is None else load(scenario_path(options.scenario))
    changes = {
        name: getattr(options, name)
        for name in ('law', 'estimator')
        if getattr(options, name) is not None
    }
    if options.scene is not None:
        scenario = replace(scenario, camera=replace(scenario.camera, scene_seed=options.scene))
    return scenario.seeded(options.seed).with_servo(changes)


def output_folder(name: str) -> Path:
    """Return the folder called ``name``, created if missing; raises InputError if that fails."""
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{folder}: folder cannot be made: {error.strerror}') from None
    return folder


def publish(document: Mapping[str, Any], text: str, target: str | None) -> None:
    """Write ``document`` to ``target``, then print ``text``, unless standard output has it."""
    write_json(document, target)
    if target != '-':
        print(text)


def write_json(document: Mapping[str, Any], target: str | None) -> None:
    """Write ``document`` to a file, by rename, or to standard output; nan becomes null."""
    if target is None:
        return
    text = json.dumps(_plain(document), indent=2, allow_nan=False) + '\n'
    if target == '-':
        sys.stdout.write(text)
        return
    check_json(target)
    try:
        write_whole(Path(target), text.encode())
    except OSError as error:
        raise InputError(f'{target}: result cannot be written: {error.strerror}') from None


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
