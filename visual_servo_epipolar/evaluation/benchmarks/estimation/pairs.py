"""Folders of photographs with truth: pairs, cameras, and a truth.json."""

from collections.abc import Iterator
import json
from pathlib import Path
from typing import Any

import numpy as np

from visual_servo_epipolar.commands.files.camera import read_camera, read_photograph, scaled_to
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.evaluation.benchmarks.real import Photographs

KEYS = ('bearing_current_deg', 'bearing_desired_deg', 'rotation_deg')


def read_pairs(folder: str) -> Iterator[Photographs]:
    """Return the pairs of a ``folder``, one after the other; InputError if it has none."""
    path = Path(folder) / 'truth.json'
    try:
        pairs = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f'{path} cannot be read: {error.strerror}; name its folder') from None
    except ValueError:
        raise InputError(f'{path} must be JSON; see docs/commands/bench.md') from None
    if not isinstance(pairs, list) or not pairs:
        raise InputError(f'{path} must be a list of pairs; see docs/commands/bench.md')
    return (_read(pair, path) for pair in pairs)


def _read(pair: Any, path: Path) -> Photographs:
    try:
        name, files = str(pair['name']), [pair[key] for key in ('desired', 'current', 'camera')]
        truth = pair['truth']
        ground = [float(truth[key]) for key in KEYS]
        own = [float(truth.get('camera_frame', truth)[key]) for key in KEYS]
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f'{path}: a pair must have name, desired, current, camera and truth, got '
            f'{str(pair)[:60]}; see docs/commands/bench.md'
        ) from None
    first, second, camera_file = (path.parent / str(file) for file in files)
    desired, current = read_photograph(first), read_photograph(second)
    camera = read_camera(str(camera_file))
    cameras = scaled_to(camera, desired, first), scaled_to(camera, current, second)
    group = camera_file.stem
    return Photographs(
        name, group, (desired, current), cameras, np.radians(ground), np.radians(own)
    )
