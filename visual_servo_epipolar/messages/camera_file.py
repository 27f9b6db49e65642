"""Camera files as camera_calibration writes them: parsed YAML into cameras and back."""

from collections.abc import Mapping
from typing import Any

from visual_servo_epipolar.core.geometry.cameras.calibrated import (
    calibrated_camera,
    CalibratedCamera,
)
from visual_servo_epipolar.core.geometry.cameras.plausibility import refuse_implausible


def from_document(document: Any, *, rectified: bool = False) -> CalibratedCamera:
    """
    Return the camera of a parsed file; of its ``rectified`` images by projection_matrix alone.

    Raises
    ------
    ValueError
        If it lacks something, or is no camera.

    """
    if not isinstance(document, Mapping):
        raise ValueError('a camera file must map names to values, as calibration writes')
    try:
        camera = _rectified(document) if rectified else _camera(document)
        refuse_implausible(camera)
        return camera
    except KeyError as error:
        raise ValueError(f'camera file lacks {error}; write it with camera_calibration') from None
    except (OverflowError, TypeError) as error:
        raise ValueError(str(error)) from None


def to_document(camera: CalibratedCamera) -> dict[str, Any]:
    """Return what ``from_document`` makes this camera of."""
    return {
        'image_width': camera.width,
        'image_height': camera.height,
        'camera_matrix': _matrix(3, 3, camera.matrix.ravel().tolist()),
        'distortion_model': camera.distortion_model,
        'distortion_coefficients': _matrix(1, len(camera.distortion), list(camera.distortion)),
    }


def _matrix(rows: int, cols: int, data: list[float]) -> dict[str, Any]:
    return {'rows': rows, 'cols': cols, 'data': [float(value) for value in data]}


def _camera(document: Mapping[str, Any]) -> CalibratedCamera:
    k = [float(value) for value in document['camera_matrix']['data']]
    if len(k) != 9:
        raise ValueError(f'camera_matrix must have nine numbers, got {len(k)}')
    coefficients = document.get('distortion_coefficients') or {'data': []}
    distortion = tuple(float(value) for value in coefficients['data'])
    model = str(document.get('distortion_model', 'plumb_bob'))
    return calibrated_camera(_size(document), tuple(k), distortion, model)


def _rectified(document: Mapping[str, Any]) -> CalibratedCamera:
    p = [float(value) for value in document['projection_matrix']['data']]
    if len(p) != 12:
        raise ValueError(f'projection_matrix must have twelve numbers, got {len(p)}')
    return calibrated_camera(_size(document), (*p[0:3], *p[4:7], *p[8:11]))


def _size(document: Mapping[str, Any]) -> tuple[int, int]:
    return int(document['image_width']), int(document['image_height'])
