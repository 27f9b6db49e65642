"""Inspection of two photographs: their epipoles, and whether to trust them."""

import argparse
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.commands.camera_files import read_pair
from visual_servo_epipolar.commands.outputs import publish
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.matchers.registry import matcher_of
from visual_servo_epipolar.core.twoview.inspection import inspect, Inspection
from visual_servo_epipolar.files import write_whole


def run(options: argparse.Namespace) -> int:
    """Inspect, write, print; return 0 if the result can be trusted."""
    if options.out and not cv2.haveImageWriter(options.out):
        raise InputError(f'{options.out}: unknown image format; use .png or .jpg')
    (desired, current), (desired_camera, current_camera) = read_pair(
        Path(options.desired),
        Path(options.current),
        options.camera,
        rectified=options.rectified,
        cropped=options.cropped,
    )
    try:
        settings = _settings(options)
        matcher = matcher_of(options.matcher, options.matcher_model)
    except ValueError as error:
        raise InputError(str(error)) from None
    inspection = inspect(desired, current, desired_camera, current_camera, settings, matcher)
    result = document(inspection, current_camera, desired_camera)
    if options.out:
        _draw(inspection, current, current_camera, Path(options.out))
    publish(result, in_words(result), options.json)
    return 0 if inspection.trusted else 1


def _settings(options: argparse.Namespace) -> ServoSettings:
    values: dict[str, Any] = {}
    if options.estimator is not None:
        values['estimator'] = options.estimator
    if options.tilt is not None or options.roll is not None:
        deviation = math.radians(options.mount_deviation)
        values['camera_tilt'] = math.radians(options.tilt or 0.0)
        values['camera_roll'] = math.radians(options.roll or 0.0)
        values['camera_tilt_deviation'] = values['camera_roll_deviation'] = deviation
    return ServoSettings(**values)


def document(inspection: Inspection, current: CameraModel, desired: CameraModel) -> dict[str, Any]:
    """Return the inspection as the JSON document."""
    return {
        'epipole_current_px': _abscissa(inspection.bearing_current, current),
        'epipole_desired_px': _abscissa(inspection.bearing_desired, desired),
        'bearing_current_deg': math.degrees(inspection.bearing_current),
        'bearing_desired_deg': math.degrees(inspection.bearing_desired),
        'bearing_deviation_deg': math.degrees(inspection.deviation),
        'rotation_deg': math.degrees(inspection.rotation),
        'rotation_deviation_deg': math.degrees(inspection.rotation_deviation),
        'frame': 'ground' if inspection.ground else 'camera',
        'tilt_deg': math.degrees(inspection.tilt),
        'roll_deg': math.degrees(inspection.roll),
        'sigma': None if math.isnan(inspection.sigma) else int(inspection.sigma),
        'trusted': inspection.trusted,
        'reason': inspection.reason,
        'planar': inspection.planar,
        'parallax_px': inspection.parallax_px,
        'matches': len(inspection.current),
        'inliers': inspection.inliers,
    }


def _abscissa(bearing: float, camera: CameraModel) -> float:
    """Return u of an epipole at ``bearing`` [rad], from the principal point [px]."""
    if camera.planar is not None:
        return camera.fx * math.tan(bearing)
    ray = np.array([[math.sin(bearing), 0.0, math.cos(bearing)]])
    return float(camera.pixels(ray)[0, 0] - camera.cx)


def _in_deg(angle: float) -> str:
    return 'an unknown angle' if math.isnan(angle) else f'{angle:+.1f} deg'


def in_words(result: dict[str, Any]) -> str:
    """Return the result as text."""
    verdict = 'trusted' if result['trusted'] else 'NOT trusted'
    lines = [verdict + (f': {result["reason"]}' if result['reason'] else '')]
    agreeing = f'{result["inliers"]} agree, ' if result['inliers'] else ''
    lines.append(f'{result["matches"]} matches, {agreeing}parallax {result["parallax_px"]:.1f} px')
    if not math.isnan(result['rotation_deg']):
        lines.append(f'heading {result["rotation_deg"]:+.2f} deg (left positive)')
    if not math.isnan(result['bearing_current_deg']):
        lines.append(
            f'epipoles {result["epipole_current_px"]:+.1f} px in the current, '
            f'{result["epipole_desired_px"]:+.1f} px in the desired image'
        )
        lines.append(
            f'the goal lies at {result["bearing_current_deg"]:+.2f} deg, the camera is seen from '
            f'it at {result["bearing_desired_deg"]:+.2f} deg (right positive)'
            + ('' if result['frame'] == 'ground' else ', in axes of the cameras, not level')
        )
    if not (math.isnan(result['tilt_deg']) and math.isnan(result['roll_deg'])):
        lines.append(
            f'the camera is tilted by {_in_deg(result["tilt_deg"])} (down positive) and rolled by '
            f'{_in_deg(result["roll_deg"])} (clockwise)'
        )
    return '\n'.join(lines)


def _draw(inspection: Inspection, image: Image, camera: CameraModel, path: Path) -> None:
    from visual_servo_epipolar.report.images.overlay import draw_overlay

    epipole = camera.cx + _abscissa(inspection.bearing_current, camera)
    picture = draw_overlay(
        image,
        inspection.current,
        inspection.desired,
        header='inspected' if inspection.trusted else 'not trusted',
        epipole_current=epipole if math.isfinite(epipole) else None,
        horizon=camera.cy,
        fundamental=inspection.fundamental if inspection.trusted else None,
    )
    write_whole(path, np.asarray(cv2.imencode(path.suffix, picture)[1]).tobytes())
