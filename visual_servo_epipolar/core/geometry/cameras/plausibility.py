"""Intrinsics held against reason: what no camera is, and what a lens can only half undo."""

from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.cameras.calibrated import CalibratedCamera

FARTHEST_OUTSIDE = 0.5  # of the image's size, that the principal point may lie beyond it
NARROWEST, WIDEST_PINHOLE, WIDEST = 1.0, 170.0, 360.0  # field of view [deg]
MOST_LOST = 0.2  # of the image, where the distortion cannot be undone
MOST_OBLONG = 4.0  # pixel: binned in one direction, or every other line
SAMPLES = 24  # a row and a column, over the image
CALIBRATION_DEG = 1.0  # that a ray may differ from one calibration to another


def refuse_implausible(camera: CalibratedCamera) -> None:
    """Raise ValueError for intrinsics that no camera has: they are another image's, or a slip."""
    fault = _fault(camera)
    if fault:
        raise ValueError(fault)


@lru_cache(maxsize=16)
def doubts(camera: CalibratedCamera) -> str:
    """Return what is to be said of a camera that can be used all the same, or ''."""
    pixels = _samples(camera)
    lost = 1.0 - float(camera.round_trips(pixels, camera.rays(pixels)).mean())
    if lost <= MOST_LOST:
        return ''
    return (
        f'the distortion of camera_info ({camera.lens}) cannot be undone in {100.0 * lost:.0f} % '
        'of the image, features there are left out; a wide lens needs equidistant: calibrate it '
        'as a fisheye'
    )


def are_alike(one: CalibratedCamera, other: CalibratedCamera) -> bool:
    """Return whether both see the same directions: one camera, maybe calibrated anew."""
    if (one.width, one.height) != (other.width, other.height):
        return False
    pixels = _samples(one)
    rays, others = one.rays(pixels), other.rays(pixels)
    known = np.isfinite(rays).all(axis=1) & np.isfinite(others).all(axis=1)
    cosines = (rays[known] * others[known]).sum(axis=1)
    return bool(known.any() and cosines.min() > math.cos(math.radians(CALIBRATION_DEG)))


def _samples(camera: CalibratedCamera) -> FloatArray:
    """Return pixels, (N, 2), all over the image."""
    u, v = np.meshgrid(
        np.linspace(0.0, camera.width - 1.0, SAMPLES),
        np.linspace(0.0, camera.height - 1.0, SAMPLES),
    )
    return np.stack([u.ravel(), v.ravel()], axis=1)


@lru_cache(maxsize=16)
def _fault(camera: CalibratedCamera) -> str:
    for name, centre, size in (
        ('u', camera.cx, camera.width),
        ('v', camera.cy, camera.height),
    ):
        reach = FARTHEST_OUTSIDE * size
        if not -reach <= centre <= size + reach:
            return (
                f'the principal point must lie in the image or near it, got {name} = {centre:.1f} '
                f'px of {size}; is the camera_info that of another image? calibrate again'
            )
    if not 1.0 / MOST_OBLONG <= camera.fx / camera.fy <= MOST_OBLONG:
        return (
            f'focal lengths must be alike, to a factor of {MOST_OBLONG:g}, got fx {camera.fx:g} '
            f'and fy {camera.fy:g} px; calibrate again'
        )
    widest = WIDEST_PINHOLE if isinstance(camera, Camera) else WIDEST
    view = _field_of_view(camera)
    if not NARROWEST <= view <= widest:
        return (
            f'the field of view of a {camera.lens} lens must lie between {NARROWEST:g} and '
            f'{widest:g} deg, got {view:.2f}: fx {camera.fx:g} px at a width of {camera.width}; '
            'calibrate at the resolution in use'
        )
    if isinstance(camera, Camera) and not np.isfinite(camera.edges).all():
        return (
            f'the edges of the image must have rays, got {camera.edges} rad through its '
            f'{camera.lens} distortion; calibrate again'
        )
    return ''


def _field_of_view(camera: CalibratedCamera) -> float:
    """Return the smaller of the angles over width and height, without coefficients [deg]."""
    spans = [
        (camera.cx / camera.fx, (camera.width - 1.0 - camera.cx) / camera.fx),
        (camera.cy / camera.fy, (camera.height - 1.0 - camera.cy) / camera.fy),
    ]
    if isinstance(camera, Camera):
        spans = [(math.atan(before), math.atan(after)) for before, after in spans]
    return math.degrees(min(before + after for before, after in spans))
