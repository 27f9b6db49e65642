"""Cameras of Kalibr's camchain, and of EuRoC's sensor.yaml."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from visual_servo_epipolar.core.cameras.registry import lens_name
from visual_servo_epipolar.messages.calibrations.calibration import (
    Calibration,
    Cameras,
    entry,
    numbers,
    text,
    whole_number,
)

KALIBR_LENSES = ('', 'plumb_bob', 'equidistant')  # none, radtan, equidistant, by ROS names


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
