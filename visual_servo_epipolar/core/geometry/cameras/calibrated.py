"""Cameras by the names that CameraInfo and calibration files give their lenses."""

from typing import TypeAlias

from visual_servo_epipolar.core.geometry.camera import Camera, DISTORTION_MODELS
from visual_servo_epipolar.core.geometry.cameras.equidistant import Equidistant

CalibratedCamera: TypeAlias = Camera | Equidistant
FISHEYES = ('equidistant', 'fisheye')  # the same lens: some drivers say the second
LENSES = (*(name for name in DISTORTION_MODELS if name), 'equidistant')


def calibrated_camera(
    size: tuple[int, int],
    k: tuple[float, ...],
    distortion: tuple[float, ...] = (),
    distortion_model: str = 'plumb_bob',
) -> CalibratedCamera:
    """
    Return the camera of an image ``size`` [px], K by rows (nine numbers) and a named lens.

    Raises
    ------
    ValueError
        If there is no such camera.

    """
    if k[1] != 0.0:
        raise ValueError(f'a camera matrix must have no skew, got K[1] = {k[1]}; calibrate again')
    if distortion_model in FISHEYES:
        return Equidistant(*size, k[0], k[4], k[2], k[5], distortion)
    return Camera(*size, k[0], k[4], k[2], k[5], distortion, distortion_model)
