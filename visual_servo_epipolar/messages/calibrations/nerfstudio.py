"""Nerfstudio's transforms.json: one camera for all frames, or one in each."""

from collections.abc import Mapping
from functools import partial
import math
from typing import Any

from visual_servo_epipolar.messages.calibrations.calibration import (
    Calibration,
    Cameras,
    entry,
    number,
    text,
    whole_number,
)
from visual_servo_epipolar.messages.calibrations.colmap import HALF_PIXEL

NAMES = (
    *('fl_x', 'fl_y', 'camera_angle_x', 'camera_angle_y', 'cx', 'cy', 'w', 'h'),
    *('k1', 'k2', 'k3', 'k4', 'p1', 'p2', 'camera_model', 'is_fisheye'),
)
PINHOLES = ('SIMPLE_PINHOLE', 'PINHOLE', 'SIMPLE_RADIAL', 'RADIAL', 'OPENCV')
FISHEYE = 'OPENCV_FISHEYE'


def cameras(document: Mapping[str, Any]) -> Cameras:
    """Return the cameras of the frames, alike ones once; none if it is no such document."""
    frames = document.get('frames')
    frames = frames if isinstance(frames, list) else []
    rows = [row for row in (document, *frames) if isinstance(row, Mapping)]
    if not any(key in row for row in rows for key in ('fl_x', 'camera_angle_x')):
        return {}
    shared = {name: document[name] for name in NAMES if name in document}
    found: dict[str, dict[str, Any]] = {}
    for index, row in enumerate(rows[1:] or rows):
        camera = {**shared, **{name: row[name] for name in NAMES if name in row}}
        if camera not in found.values():
            found[str(row.get('file_path', index))] = camera
    return {name: partial(_calibration, camera) for name, camera in found.items()}


def _calibration(camera: Mapping[str, Any]) -> Calibration:
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
