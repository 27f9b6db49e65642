"""Camera files, by what is in them: cameras of other programs' calibrations, and back."""

from collections.abc import Mapping
from dataclasses import replace
import re
from typing import Any

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.calibrations.calibration import (
    Calibration,
    Cameras,
    cameras_by_keys,
    kalibr_cameras,
)
from visual_servo_epipolar.messages.calibrations.documents import documents

KINDS = (
    "camera_calibration's ost.yaml and ost.txt, ros2 topic echo of a camera_info, OpenCV's "
    "FileStorage (YAML, XML, JSON), Kalibr's camchain"
)
# Images of both begin at the edge of their first pixel, ours in its middle.
CONVERTED = (
    'camera file is of {}, which is not read; write it as YAML: image_width, image_height, '
    'camera_matrix [fx, 0, cx - 0.5, 0, fy, cy - 0.5, 0, 0, 1], distortion_model plumb_bob or '
    'equidistant, distortion_coefficients [k1, k2, p1, p2] or [k1, k2, k3, k4]'
)
COLMAP_LINE = re.compile(r'\d+ [A-Z][A-Z_0-9]+ \S+ \S+ .*', re.DOTALL)
NERFSTUDIO_KEYS = {'fl_x', 'camera_angle_x', 'frames'}
READERS = (kalibr_cameras, cameras_by_keys)
NAMED = 5  # of the cameras of a file, in a message


def from_text(
    text: str,
    *,
    name: str = '',
    size: tuple[int, int] | None = None,
    rectified: bool = False,
    cropped: bool = False,
) -> CameraModel:
    """
    Return the camera of a file, that of ``name`` where it has several.

    ``size`` [px] is that of the images, for files that have none. Of ``rectified`` images
    projection_matrix alone holds; those that are ``cropped`` have their principal point anywhere.

    Raises ValueError if the file is none of KINDS, lacks something, or is of no camera that
    can be used.
    """
    text = text.removeprefix('\ufeff')  # as editors of Windows begin a file
    calibration = _with_size(_chosen(_cameras(documents(text)), name), size)
    if rectified and not calibration.p:
        raise ValueError(
            "camera file lacks 'projection_matrix', which rectified images need; write it with "
            'camera_calibration'
        )
    return read.camera(calibration, rectified=rectified, cropped=cropped)


def from_document(document: Any) -> CameraModel:
    """Return the camera of a parsed file that was written for images that were used."""
    return read.camera(_with_size(_chosen(_cameras([document]), ''), None), cropped=True)


def to_document(camera: CameraModel) -> dict[str, Any]:
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


def _cameras(parsed: list[Any]) -> Cameras:
    """Return the cameras of documents; alike ones, as a console prints them, once."""
    found: dict[str, Any] = {}
    known: list[Any] = []
    for index, document in enumerate(parsed):
        if isinstance(document, str) and COLMAP_LINE.fullmatch(document):
            raise ValueError(CONVERTED.format('COLMAP'))
        if not isinstance(document, Mapping):
            raise ValueError(f'a camera file must map names to values; supported are {KINDS}')
        if NERFSTUDIO_KEYS & document.keys():
            raise ValueError(CONVERTED.format('nerfstudio'))
        content = {key: value for key, value in document.items() if key != 'header'}
        if content in known:
            continue
        known.append(content)
        for read_cameras in READERS:
            cameras = read_cameras(content)
            if cameras:
                found |= {name or str(index + 1): camera for name, camera in cameras.items()}
                break
    if not found:
        raise ValueError(f"camera file lacks 'camera_matrix'; supported are {KINDS}")
    return found


def _chosen(cameras: Cameras, name: str) -> Calibration:
    """Return the calibration of ``name``, or of the only camera there is."""
    if name not in cameras and (name or len(cameras) > 1):
        names = ', '.join([*cameras][:NAMED]) + (', ...' if len(cameras) > NAMED else '')
        raise ValueError(
            f'the file has the cameras {names}, got {name or "no name"}; choose one, as in '
            f'FILE#{next(iter(cameras))}'
        )
    return cameras[name or next(iter(cameras))]()


def _with_size(calibration: Calibration, size: tuple[int, int] | None) -> Calibration:
    if calibration.width:
        return calibration
    if size is None:
        raise ValueError(f'camera file has no image size; add {calibration.size_keys} to it')
    return replace(calibration, width=size[0], height=size[1])
