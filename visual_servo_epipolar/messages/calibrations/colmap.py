"""COLMAP's cameras.txt: a line a camera, with its model and the parameters of that."""

from collections.abc import Sequence
from functools import partial
import re

from visual_servo_epipolar.messages.calibrations.calibration import (
    Calibration,
    Cameras,
    numbers,
    whole_number,
)

LINE = re.compile(r'\d+\s+[A-Z][A-Z_0-9]+\s+\S+\s+\S+(\s+\S+)+')
HALF_PIXEL = 0.5  # COLMAP's image begins at 0, ours at the middle of its first pixel
# Focal lengths, coefficients in COLMAP's order, and the lens that has them.
MODELS = {
    'SIMPLE_PINHOLE': (1, 0, ''),
    'PINHOLE': (2, 0, ''),
    'SIMPLE_RADIAL': (1, 1, 'plumb_bob'),
    'RADIAL': (1, 2, 'plumb_bob'),
    'OPENCV': (2, 4, 'plumb_bob'),
    'FULL_OPENCV': (2, 8, 'rational_polynomial'),
    'SIMPLE_RADIAL_FISHEYE': (1, 1, 'equidistant'),
    'RADIAL_FISHEYE': (1, 2, 'equidistant'),
    'OPENCV_FISHEYE': (2, 4, 'equidistant'),
}


def cameras(text: str) -> Cameras:
    """Return the cameras of a cameras.txt by their numbers, none if it is no such file."""
    lines = [line.strip() for line in text.splitlines()]
    rows = [line.split() for line in lines if line and not line.startswith('#')]
    if not rows or not LINE.fullmatch(' '.join(rows[0])):
        return {}
    return {row[0]: partial(_calibration, row) for row in rows}


def _calibration(row: Sequence[str]) -> Calibration:
    where = f'camera {row[0]}'
    if len(row) < 5:
        raise ValueError(f'{where} must have a model, width, height and parameters')
    model = row[1]
    if model not in MODELS:
        raise ValueError(
            f'the model of {where} must be one of {", ".join(MODELS)}, got {model!r:.40}; '
            'reconstruct with one of them'
        )
    focal, count, lens = MODELS[model]
    values = numbers(row[4:], f'the parameters of {where} ({model})', (focal + 2 + count,))
    fx, fy = values[0], values[focal - 1]
    cx, cy = (value - HALF_PIXEL for value in values[focal : focal + 2])
    distortion = values[focal + 2 :]
    return Calibration(
        width=whole_number(row[2], f'the width of {where}'),
        height=whole_number(row[3], f'the height of {where}'),
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        d=(*distortion, *[0.0] * (4 - count)) if lens else (),
        distortion_model=lens,
    )
