"""Camera picture with the measurement of the servo: features, epipole, epipolar lines."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    fundamental_from_bearings,
    in_pixels,
)
from visual_servo_epipolar.core.geometry.motion import HALF_PI, wrap_angle
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.report.images.overlay import draw_overlay
from visual_servo_epipolar.report.style import phase_label


def picture(
    image: Image,
    features: Features,
    sample: Sample,
    camera: CameraModel,
    size: tuple[int, int] | None = None,
) -> Image:
    """
    Return ``image``, grey of shape (H, W), with features, epipole and epipolar lines.

    Only a pinhole has epipolar lines that are straight: of others they are left out. ``size`` is
    that of the picture, width and height [px]; if not given, the image's.
    """
    has_bearing = bool(np.isfinite(sample.bearing_current))
    u, v = epipole(sample, camera) if has_bearing else (None, None)
    lines = None
    if has_bearing and camera.planar is not None:
        lines = fundamental(sample, camera)
    return draw_overlay(
        image,
        features.current,
        features.desired,
        header=phase_label(sample.phase.value),
        colour=phase_colour(sample.phase.value),
        epipole_current=u,
        horizon=v,
        fundamental=lines,
        size=size,
    )


def epipole(sample: Sample, camera: CameraModel) -> tuple[float, float]:
    """Return where an upright camera sees the goal's camera [px]; nan where it does not."""
    if camera.planar is not None:
        return camera.cx + sample.epipole_current, camera.cy
    bearing = sample.bearing_current
    ((u, v),) = camera.pixels(np.array([[np.sin(bearing), 0.0, np.cos(bearing)]])).tolist()
    return u, v


def fundamental(sample: Sample, camera: CameraModel) -> FloatArray:
    """Return F in pixels, shape (3, 3), of an upright camera with the bearings of ``sample``."""
    psi = HALF_PI - sample.bearing_desired
    phi = wrap_angle(np.pi - sample.bearing_current)
    return in_pixels(fundamental_from_bearings(Bearings(psi, phi)), camera.matrix, camera.matrix)
