"""Camera files as camera_calibration writes them, and photographs, from disk."""

from pathlib import Path

import yaml

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.cameras.calibrated import CalibratedCamera, scaled
from visual_servo_epipolar.messages.camera_file import from_document
from visual_servo_epipolar.nodes.tracking.photograph import read_picture

ASPECT_TOLERANCE = 0.01


def read_camera(path: Path, *, rectified: bool = False) -> CalibratedCamera:
    """
    Read a camera YAML file; raises InputError if it cannot be read or used.

    Needed are image_width, image_height and camera_matrix; distortion_model and
    distortion_coefficients are taken if they are there. For ``rectified`` images projection_matrix
    is, and they are not.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise InputError(f'{path}: camera file cannot be read: {reason}') from None
    except yaml.YAMLError as error:
        raise InputError(f'{path}: camera file is not YAML: {error}') from None
    try:
        return from_document(document, rectified=rectified)
    except ValueError as error:
        raise InputError(f'{path}: {error}') from None


def read_photograph(path: Path) -> Image:
    """Read an image file as grey levels; raises InputError if it is none."""
    try:
        image = read_picture(path)
    except OSError as error:
        raise InputError(f'{path}: photograph cannot be read: {error.strerror}') from None
    if image is None:
        raise InputError(f'{path}: not an image that can be decoded; give a PNG or JPEG file')
    return image


def scaled_to(camera: CalibratedCamera, image: Image, path: Path) -> CalibratedCamera:
    """Return ``camera`` for an image that was taken with it and then scaled as a whole."""
    height, width = image.shape
    scale_u, scale_v = width / camera.width, height / camera.height
    if abs(scale_u / scale_v - 1.0) > ASPECT_TOLERANCE:
        raise InputError(
            f'{path}: image has {width}x{height} px, the camera {camera.width}x{camera.height}, '
            'another aspect ratio; do not crop, and use the calibration of this camera'
        )
    return scaled(camera, (width, height), scale_u, scale_v)
