"""Cameras of other programs: Kalibr's camchain, COLMAP's cameras.txt, nerfstudio's transforms."""

from collections.abc import Mapping, Sequence
from functools import partial
import math
import re
from typing import Any

from visual_servo_epipolar.core.cameras.registry import lens_name
from visual_servo_epipolar.messages.calibrations.calibration import (
    Calibration,
    Cameras,
    entry,
    number,
    numbers,
    text,
    whole_number,
)

KALIBR_LENSES = ('', 'plumb_bob', 'equidistant')  # none, radtan, equidistant, by ROS names
COLMAP_LINE = re.compile(r'\d+\s+[A-Z][A-Z_0-9]+\s+\S+\s+\S+(\s+\S+)+')
HALF_PIXEL = 0.5  # COLMAP's image begins at 0, ours at the middle of its first pixel
# Focal lengths, coefficients in COLMAP's order, and the lens that has them.
COLMAP_MODELS = {
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
NERFSTUDIO_KEYS = (
    *('fl_x', 'fl_y', 'camera_angle_x', 'camera_angle_y', 'cx', 'cy', 'w', 'h'),
    *('k1', 'k2', 'k3', 'k4', 'p1', 'p2', 'camera_model', 'is_fisheye'),
)
PINHOLES = ('SIMPLE_PINHOLE', 'PINHOLE', 'SIMPLE_RADIAL', 'RADIAL', 'OPENCV')
FISHEYE = 'OPENCV_FISHEYE'


def kalibr_cameras(document: Mapping[str, Any]) -> Cameras:
    """Return the cameras of Kalibr's camchain, or EuRoC's; none if it is no such document."""
    if _is_camera(document):
        return {'': partial(_of_kalibr, document, '')}
    return {
        str(name): partial(_of_kalibr, camera, f'{name}.')
        for name, camera in document.items()
        if _is_camera(camera)
    }


def _is_camera(value: Any) -> bool:
    return isinstance(value, Mapping) and {'camera_model', 'intrinsics'} <= value.keys()


def _of_kalibr(camera: Mapping[str, Any], prefix: str) -> Calibration:
    model = text(camera['camera_model'], f'{prefix}camera_model')
    if model != 'pinhole':
        raise ValueError(
            f'{prefix}camera_model must be pinhole, got {model!r:.40}: omni, ds and eucm are '
            'other projections; calibrate with pinhole-radtan, or pinhole-equi for a fisheye'
        )
    fx, fy, cx, cy = numbers(camera['intrinsics'], f'{prefix}intrinsics', (4,))
    name = text(camera.get('distortion_model', 'none'), f'{prefix}distortion_model')
    if lens_name(name) not in KALIBR_LENSES:
        raise ValueError(
            f'{prefix}distortion_model must be radtan, equidistant or none, got {name!r:.40}; '
            'calibrate with pinhole-radtan, or pinhole-equi for a fisheye'
        )
    width, height = _resolution(camera, prefix)
    key = 'distortion_coeffs' if 'distortion_coeffs' in camera else 'distortion_coefficients'
    coefficients = entry(camera, key) if lens_name(name) else camera.get(key, ())
    return Calibration(
        width=width,
        height=height,
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        d=numbers(coefficients, f'{prefix}{key}'),
        distortion_model=name,
        size_keys=f'{prefix}resolution',
    )


def _resolution(camera: Mapping[str, Any], prefix: str) -> tuple[int, int]:
    if 'resolution' not in camera:
        return 0, 0
    key = f'{prefix}resolution'
    width, height = numbers(camera['resolution'], key, (2,))
    return whole_number(width, key), whole_number(height, key)


def colmap_cameras(content: str) -> Cameras:
    """Return the cameras of COLMAP's cameras.txt by their numbers, none if it is no such file."""
    lines = [line.strip() for line in content.splitlines()]
    rows = [line.split() for line in lines if line and not line.startswith('#')]
    if not rows or not COLMAP_LINE.fullmatch(' '.join(rows[0])):
        return {}
    return {row[0]: partial(_of_colmap, row) for row in rows}


def _of_colmap(row: Sequence[str]) -> Calibration:
    where = f'camera {row[0]}'
    if len(row) < 5:
        raise ValueError(f'{where} must have a model, width, height and parameters')
    model = row[1]
    if model not in COLMAP_MODELS:
        raise ValueError(
            f'the model of {where} must be one of {", ".join(COLMAP_MODELS)}, got {model!r:.40}; '
            'reconstruct with one of them'
        )
    focal, count, lens = COLMAP_MODELS[model]
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


def nerfstudio_cameras(document: Mapping[str, Any]) -> Cameras:
    """Return the cameras of the frames in a transforms.json, alike ones once; {} of another."""
    frames = document.get('frames')
    frames = frames if isinstance(frames, list) else []
    rows = [row for row in (document, *frames) if isinstance(row, Mapping)]
    if not any(key in row for row in rows for key in ('fl_x', 'camera_angle_x')):
        return {}
    shared = {name: document[name] for name in NERFSTUDIO_KEYS if name in document}
    found: dict[str, dict[str, Any]] = {}
    for index, row in enumerate(rows[1:] or rows):
        camera = {**shared, **{name: row[name] for name in NERFSTUDIO_KEYS if name in row}}
        if camera not in found.values():
            found[str(row.get('file_path', index))] = camera
    return {name: partial(_of_nerfstudio, camera) for name, camera in found.items()}


def _of_nerfstudio(camera: Mapping[str, Any]) -> Calibration:
    width, height = (whole_number(camera[key], key) if key in camera else 0 for key in ('w', 'h'))
    if bool(width) != bool(height):
        entry(camera, 'h' if width else 'w')
    fx = _focal(camera, 'x', width)
    fy = _focal(camera, 'y', height) if {'fl_y', 'camera_angle_y'} & camera.keys() else fx
    if not width and not {'cx', 'cy'} <= camera.keys():
        raise ValueError('camera file has no image size; add w and h to it')
    cx = number(camera.get('cx', 0.5 * width), 'cx')
    cy = number(camera.get('cy', 0.5 * height), 'cy')
    lens, distortion = _lens(camera)
    return Calibration(
        width=width,
        height=height,
        k=(fx, 0.0, cx - HALF_PIXEL, 0.0, fy, cy - HALF_PIXEL, 0.0, 0.0, 1.0),
        d=distortion,
        distortion_model=lens,
        size_keys='w and h',
    )


def _focal(camera: Mapping[str, Any], axis: str, side: int) -> float:
    if f'fl_{axis}' in camera:
        return number(camera[f'fl_{axis}'], f'fl_{axis}')
    key = f'camera_angle_{axis}'
    angle = number(entry(camera, key), key)
    if not 0.0 < angle < math.pi:
        raise ValueError(f'{key} must lie between 0 and pi rad, got {angle:g}')
    if not side:
        raise ValueError('camera file has no image size; add w and h to it')
    return 0.5 * side / math.tan(0.5 * angle)


def _lens(camera: Mapping[str, Any]) -> tuple[str, tuple[float, ...]]:
    k1, k2, k3, k4, p1, p2 = (
        number(camera.get(key, 0.0), key) for key in ('k1', 'k2', 'k3', 'k4', 'p1', 'p2')
    )
    fisheye = camera.get('is_fisheye') is True
    model = text(camera.get('camera_model', FISHEYE if fisheye else 'OPENCV'), 'camera_model')
    if model == FISHEYE:
        return 'equidistant', (k1, k2, k3, k4)
    if model not in PINHOLES:
        raise ValueError(
            f'camera_model must be {", ".join(PINHOLES)} or {FISHEYE}, got {model!r:.40}; '
            'undistort the images to one of them'
        )
    if k4:
        raise ValueError(f'k4 of {model} must be 0, got {k4:g}; a fisheye has k4: {FISHEYE}')
    return 'plumb_bob', (k1, k2, p1, p2, k3)
