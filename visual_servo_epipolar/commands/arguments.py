"""Arguments of the command line: what words may be, and the options that commands share."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import math
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from visual_servo_epipolar.commands.outputs import OutputFile, OutputFolder
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.phase import law_names
from visual_servo_epipolar.core.settings import alike
from visual_servo_epipolar.files import config_folders, config_names
from visual_servo_epipolar.simulation.choices import SOURCES

if TYPE_CHECKING:
    from visual_servo_epipolar.simulation.scenario import Scenario

MAX_SEED, MAX_RUNS = 2**31 - 1, 1_000_000
FARTHEST = 100.0  # start [m]: nothing drives home from farther


def finite(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number') from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not finite')
    return value


def number(fits: Callable[[float], bool], words: str) -> Callable[[str], float]:
    """Return what parses a finite number that ``fits``; others are refused by ``words``."""

    def parse(text: str) -> float:
        value = finite(text)
        if not fits(value):
            raise argparse.ArgumentTypeError(f'{text!r} {words}')
        return value

    return parse


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return what parses a whole number from ``low`` to ``high``."""

    def parse(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(
                f'{text!r} is not a whole number from {low} to {high}'
            )
        return int(text)

    return parse


duration = number(lambda value: value > 0.0, 'is not a time above 0 s')
angle = number(lambda value: abs(value) <= 90.0, 'is not an angle from -90 to 90 deg')
tolerance = number(lambda value: value >= 0.0, 'is negative')
seed = whole(0, MAX_SEED)
count = whole(1, MAX_RUNS)  # of runs, or of processes
count_or_none = whole(0, MAX_RUNS)


def law(text: str) -> str:
    """Parse the name of a law."""
    from visual_servo_epipolar.core.laws.registry import law_named  # noqa: PLC0415 numpy, late

    try:
        law_named(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def laws(text: str) -> tuple[str, ...]:
    """Parse a list of laws, each once."""
    names = tuple(law(name) for name in text.split(','))
    if len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f'{text!r} must list each law once')
    return names


def scenes(text: str) -> tuple[int, ...]:
    """Parse seeds of rooms: single ones and ranges, with commas between."""
    seeds: list[int] = []
    for part in text.split(','):
        first, dash, last = part.partition('-')
        ends = seed(first), seed(last if dash else first)
        if not 0 <= ends[1] - ends[0] < MAX_RUNS:
            raise argparse.ArgumentTypeError(
                f'{part!r} is not a range, the smaller number first, of up to {MAX_RUNS}'
            )
        seeds += range(ends[0], ends[1] + 1)
    return tuple(seeds)


class StartAction(argparse.Action):
    """Take a start that lies where a robot may be."""

    def __call__(self, parser: Any, namespace: Any, values: Any, *_: object) -> None:
        """Keep x [m], y [m], heading error [deg]; ArgumentError if they are too large."""
        x, y, heading = values
        if max(abs(x), abs(y)) > FARTHEST or abs(heading) > 360.0:
            raise argparse.ArgumentError(
                self,
                f'x and y must lie within {FARTHEST:g} m and the heading within 360 deg of the '
                f'goal, got {x:g} {y:g} {heading:g}',
            )
        setattr(namespace, self.dest, values)


def add_words(parser: Any, rows: Mapping[str, str], **more: Any) -> None:
    """
    Add options that take words or paths: name and placeholder -> help; ``more``: argparse's.

    The help tells a default, unless that is empty.
    """
    default = more.get('default')
    ending = ' (default %(default)s)' if default or default == 0 else ''
    for names, text in rows.items():
        option, placeholder = names.split(' ', 1)
        parser.add_argument(
            option, metavar=placeholder, help=text + ending, **{'type': os.path.expanduser, **more}
        )


def add_lists(parser: argparse.ArgumentParser, rows: Mapping[str, str]) -> None:
    """Add options that take several words, also when they are repeated: as ``add_words``."""
    add_words(parser, rows, nargs='+', action='extend', default=[])


def add_flags(parser: argparse.ArgumentParser, rows: Mapping[str, str]) -> None:
    """Add options without a word: name -> help."""
    for option, text in rows.items():
        parser.add_argument(option, action='store_true', help=text)


def add_start(parser: argparse.ArgumentParser, *default: float) -> None:
    """Add --start, which is required unless there is a ``default``."""
    parser.add_argument(
        '--start',
        nargs=3,
        action=StartAction,
        type=finite,
        metavar=('X', 'Y', 'DEG'),
        required=not default,
        default=default,
        help='start in the plane of the paper: X to the right of the goal and Y ahead of it [m], '
        'negative behind it; DEG heading error [deg], left positive'
        + (f' (default {" ".join(f"{value:g}" for value in default)})' if default else ''),
    )


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add --source."""
    text = 'input of the servo: noisy point features, or rendered images'
    add_choice(parser, '--source', SOURCES, text)


def add_choice(
    parser: argparse.ArgumentParser, option: str, names: Sequence[str], text: str
) -> None:
    """Add an option that takes one of ``names``, the first one by default."""
    text = f'{text} (default {names[0]})'
    parser.add_argument(option, choices=names, default=names[0], help=text)


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add what every closed loop takes: law, estimator, scenario, scene, seed, --json."""
    add_words(parser, {'--law LAW': f'control law: {", ".join(law_names())}'}, type=law)
    words = {
        '--estimator NAME': 'estimator of the epipoles',
        '--scenario FILE': 'scenario file, or the name of an installed one',
        '--rig FILE': 'camera, head and base, set over the scenario: a file, or the name of an '
        'installed one, such as pinhole, fisheye, panorama (default pinhole)',
    }
    add_words(parser, words)
    add_words(parser, {'--scene N': 'seed of the room in images (default 1)'}, type=seed)
    add_seed(parser)
    add_json(parser)


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add --seed."""
    add_words(parser, {'--seed N': 'seed of all random numbers'}, type=seed, default=0)


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json."""
    text = 'write the result as JSON to FILE; - is standard output'
    add_words(parser, {'--json FILE': text}, type=OutputFile)


def add_out(parser: argparse.ArgumentParser, text: str, default: str | None = None) -> None:
    """Add --out, a folder."""
    add_words(parser, {'--out DIR': text}, type=OutputFolder, default=default)


def scenario_of(options: argparse.Namespace, **servo: float) -> 'Scenario':
    """Return the scenario that the options ask for; ``servo`` are settings that none of it has."""
    from visual_servo_epipolar.simulation.scenario import load

    scenario, rig = options.scenario, options.rig
    scenario = load(
        None if scenario is None else scenario_path(scenario),
        None if rig is None else rig_path(rig),
        servo,
    )
    changes = {
        name: getattr(options, name)
        for name in ('law', 'estimator')
        if getattr(options, name) is not None
    }
    if options.scene is not None:
        scenario = replace(scenario, camera=replace(scenario.camera, scene_seed=options.scene))
    return scenario.seeded(options.seed).with_servo(changes)


def scenario_path(name: str) -> Path:
    """Return the scenario file called ``name``: a path, or the name of an installed one."""
    return _config_path(name, 'scenario')


def rig_path(name: str) -> Path:
    """Return the file of the rig called ``name``: a path, or the name of an installed one."""
    return _config_path(name, 'rig')


def _config_path(name: str, kind: str) -> Path:
    if Path(name).is_file():
        return Path(name)
    for folder in config_folders():
        if (folder / f'{kind}s' / f'{name}.yaml').is_file():
            return folder / f'{kind}s' / f'{name}.yaml'
    names = config_names(f'{kind}s')
    close = alike(name, names)
    meant = f'; did you mean {close[0]}?' if close else ''
    raise InputError(
        f'no {kind} file {name!r}; give a path, or one of '
        f'{", ".join(names) or "none installed"}{meant}'
    )
