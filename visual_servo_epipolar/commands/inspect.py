"""``visual_servo inspect``: two photographs, their epipoles, and whether to believe them."""

import argparse
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.commands.arguments import publish
from visual_servo_epipolar.commands.files.camera import read_camera, read_photograph, scaled_to
from visual_servo_epipolar.commands.files.output import write_whole
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.perception.inspection import inspect, Inspection
from visual_servo_epipolar.core.servo.settings import ServoSettings


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'inspect', help='two photographs: epipoles, bearings, trust', description=__doc__
    )
    parser.add_argument('desired', metavar='DESIRED.png', help='photograph taken at the goal')
    parser.add_argument('current', metavar='CURRENT.png', help='photograph taken elsewhere')
    parser.add_argument(
        '--camera',
        metavar='FILE.yaml',
        required=True,
        help='camera file as camera_calibration writes it; scaled to photographs of other size',
    )
    parser.add_argument('--out', metavar='OVERLAY.png', help='picture of the matches')
    parser.add_argument('--estimator', metavar='NAME', help='estimator of the epipoles')
    parser.add_argument(
        '--json', metavar='FILE', help='write the result as JSON to FILE, - for standard output'
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Inspect, write, print; return 0 if the result can be trusted."""
    if options.out and not cv2.haveImageWriter(options.out):
        raise InputError(f'{options.out}: no such image format; call it .png or .jpg')
    camera = read_camera(Path(options.camera))
    desired = read_photograph(Path(options.desired))
    current = read_photograph(Path(options.current))
    desired_camera = scaled_to(camera, desired, Path(options.desired))
    current_camera = scaled_to(camera, current, Path(options.current))
    inspection = inspect(desired, current, desired_camera, current_camera, _settings(options))
    result = document(inspection, current_camera, desired_camera)
    if options.out:
        _draw(inspection, current, current_camera, Path(options.out))
    publish(result, in_words(result), options.json)
    return 0 if inspection.trusted else 1


def _settings(options: argparse.Namespace) -> ServoSettings:
    if options.estimator is None:
        return ServoSettings()
    try:
        return ServoSettings(estimator=options.estimator)
    except ValueError as error:
        raise InputError(str(error)) from None


def document(inspection: Inspection, current: Camera, desired: Camera) -> dict[str, Any]:
    """Return the inspection as the JSON document of the command line."""
    return {
        'epipole_current_px': current.fx * math.tan(inspection.bearing_current),
        'epipole_desired_px': desired.fx * math.tan(inspection.bearing_desired),
        'bearing_current_deg': math.degrees(inspection.bearing_current),
        'bearing_desired_deg': math.degrees(inspection.bearing_desired),
        'bearing_deviation_deg': math.degrees(inspection.deviation),
        'rotation_deg': math.degrees(inspection.rotation),
        'sigma': None if math.isnan(inspection.sigma) else int(inspection.sigma),
        'trusted': inspection.trusted,
        'reason': inspection.reason,
        'planar': inspection.planar,
        'parallax_px': inspection.parallax_px,
        'matches': len(inspection.current),
        'inliers': inspection.inliers,
    }


def in_words(result: dict[str, Any]) -> str:
    """Return the result as text."""
    verdict = 'trusted' if result['trusted'] else 'NOT trusted'
    lines = [verdict + (f': {result["reason"]}' if result['reason'] else '')]
    agreeing = f'{result["inliers"]} agree, ' if result['inliers'] else ''
    lines.append(f'{result["matches"]} matches, {agreeing}parallax {result["parallax_px"]:.1f} px')
    lines.append(f'heading {result["rotation_deg"]:+.2f} deg (left positive)')
    if not math.isnan(result['bearing_current_deg']):
        lines.append(
            f'epipoles {result["epipole_current_px"]:+.1f} px in the current, '
            f'{result["epipole_desired_px"]:+.1f} px in the desired image'
        )
        lines.append(
            f'the goal lies at {result["bearing_current_deg"]:+.2f} deg, the camera is seen from '
            f'it at {result["bearing_desired_deg"]:+.2f} deg (right positive)'
        )
    return '\n'.join(lines)


def _draw(inspection: Inspection, image: Image, camera: Camera, path: Path) -> None:
    from visual_servo_epipolar.report.images.overlay import draw_overlay

    epipole = camera.cx + camera.fx * math.tan(inspection.bearing_current)
    picture = draw_overlay(
        image,
        inspection.current,
        inspection.desired,
        phase='inspected' if inspection.trusted else 'not trusted',
        epipole_current=epipole if math.isfinite(epipole) else None,
        horizon=camera.cy,
        fundamental=inspection.fundamental if inspection.trusted else None,
    )
    write_whole(path, np.asarray(cv2.imencode(path.suffix, picture)[1]).tobytes())
