"""Arguments of the command line: what words may be, and the options that commands share."""

import argparse
from collections.abc import Iterator
from dataclasses import replace
import math
import os
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.names import law_names
from visual_servo_epipolar.core.settings import alike
from visual_servo_epipolar.simulation.choices import SOURCES

if TYPE_CHECKING:
    from visual_servo_epipolar.simulation.scenario import Scenario

MAX_SEED, MAX_RUNS, MAX_SCENES = 2**31 - 1, 1_000_000, 10_000
FARTHEST, FULL_TURN = 100.0, 360.0  # start [m], [deg]: nothing drives home from farther
CAMERA_HELP = (
    'camera file of camera_calibration, OpenCV, Kalibr, COLMAP or nerfstudio, or a camera_info '
    'as ros2 topic echo prints it; FILE#cam1 where it has several cameras'
)
CROPPED_HELP = 'the images are cut out of larger ones: the principal point may lie anywhere'
PACKAGE = 'visual_servo_epipolar'


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
    from visual_servo_epipolar.core.laws.registry import law_named  # noqa: PLC0415 numpy, late

    try:
        law_named(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


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


def angle(text: str) -> float:
    """Return an angle [deg], or raise what argparse turns into a message."""
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not abs(degrees) <= 90.0:
        raise argparse.ArgumentTypeError(f'{text!r} is no angle of -90 to 90 deg')
    return degrees


def tolerance(text: str) -> float:
    """Parse how far numbers may differ."""
    value = finite(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is negative')
    return value


class StartAction(argparse.Action):
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
        action=StartAction,
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
        help=f'control law: {", ".join(law_names())}; departures from the paper are added and '
        'left out as in paper+true_sigma or full-retreat',
    )
    parser.add_argument('--estimator', metavar='NAME', help='estimator of the epipoles')
    parser.add_argument(
        '--scenario', metavar='FILE', help='scenario file, or the name of one that is installed'
    )
    parser.add_argument(
        '--scene', type=seed, metavar='N', help='seed of the room in images (default 1)'
    )
    parser.add_argument('--seed', type=seed, default=0, metavar='N', help='seed (default 0)')
    add_json(parser)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json."""
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


def config_folders() -> Iterator[Path]:
    """Yield the folders that may hold the configuration, nearest first."""
    yield Path(__file__).resolve().parents[2] / 'config'
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        yield Path(prefix) / 'share' / PACKAGE / 'config'
    yield Path(sys.prefix) / 'share' / PACKAGE / 'config'


def scenario_path(name: str) -> Path:
    """Return the scenario file called ``name``: a path, or the name of an installed one."""
    if Path(name).is_file():
        return Path(name)
    installed = [folder / 'scenarios' for folder in config_folders()]
    for folder in installed:
        if (folder / f'{name}.yaml').is_file():
            return folder / f'{name}.yaml'
    names = sorted({path.stem for folder in installed for path in folder.glob('*.yaml')})
    close = alike(name, names)
    meant = f'; did you mean {close[0]}?' if close else ''
    raise InputError(
        f'no scenario file {name!r}; give a path, or one of '
        f'{", ".join(names) or "none installed"}{meant}'
    )
