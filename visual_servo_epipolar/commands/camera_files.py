"""Camera files and photographs, from disk."""

from pathlib import Path

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import scaled
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.messages.camera_file import from_text, KINDS
from visual_servo_epipolar.nodes.photograph import read_picture

ASPECT_TOLERANCE = 0.01


def read_camera(given: str, *, rectified: bool = False, cropped: bool = False) -> CameraModel:
    """Read a camera file, FILE or FILE#NAME; raises InputError if it cannot be read or used."""
    path, name = Path(given), ''
    if not path.exists() and '#' in given:
        file, _, name = given.rpartition('#')
        path = Path(file)
    try:
        text = path.read_text(encoding='utf-8')
    except OSError as error:
        raise InputError(f'{path}: camera file cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise InputError(f'{path}: camera file is not text; supported are {KINDS}') from None
    try:
        return from_text(text, name=name, rectified=rectified, cropped=cropped)
    except ValueError as error:
        raise InputError(f'{path}: {error}') from None


def read_photograph(path: Path) -> Image:
    """Read an image file as grey levels; raises InputError if it is none."""
    try:
        return read_picture(path, str(path))
    except OSError as error:
        raise InputError(f'{path}: photograph cannot be read: {error.strerror}') from None
    except ValueError as error:
        raise InputError(str(error)) from None


def read_pair(
    desired: Path, current: Path, camera: str, *, rectified: bool = False, cropped: bool = False
) -> tuple[tuple[Image, Image], tuple[CameraModel, CameraModel]]:
    """Return both photographs of one ``camera`` file, and the camera of each; or InputError."""
    goal, view = read_photograph(desired), read_photograph(current)
    lens = read_camera(camera, rectified=rectified, cropped=cropped)
    return (goal, view), (scaled_to(lens, goal, desired), scaled_to(lens, view, current))


def scaled_to(camera: CameraModel, image: Image, path: Path) -> CameraModel:
    """Return ``camera`` for an image that it took, then scaled as a whole."""
    height, width = image.shape
    scale_u, scale_v = width / camera.width, height / camera.height
    if abs(scale_u / scale_v - 1.0) > ASPECT_TOLERANCE:
        lying = abs(width * camera.width / (height * camera.height) - 1.0) <= ASPECT_TOLERANCE
        remedy = (
            'calibrate with the pixels as stored'
            if lying
            else 'do not crop, and use the calibration of this camera'
        )
        raise InputError(
            f'{path}: image has {width}x{height} px, the camera {camera.width}x{camera.height}, '
            f'another aspect ratio; {remedy}'
        )
    return scaled(camera, (width, height), scale_u, scale_v)
