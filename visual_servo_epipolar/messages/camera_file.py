"""Camera files: calibrations of ROS, OpenCV and Kalibr, and back."""

from collections.abc import Mapping
from dataclasses import replace
import re
from typing import Any
from xml.etree import ElementTree

import yaml

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.calibration import by_keys, Calibration, Cameras, of_kalibr

KINDS = (
    "camera_calibration's ost.yaml and ost.txt, ros2 topic echo of a camera_info, OpenCV's "
    "FileStorage (YAML, XML, JSON), Kalibr's camchain"
)
BY_HAND = (
    'write it as YAML: image_width, image_height, camera_matrix [fx, 0, cx, 0, fy, cy, 0, 0, 1], '
    'distortion_model plumb_bob or equidistant, distortion_coefficients [k1, k2, p1, p2] or [k1, '
    'k2, k3, k4]'
)
OST_KEYS = {
    'width': 'image_width',
    'height': 'image_height',
    'camera matrix': 'camera_matrix',
    'distortion': 'distortion_coefficients',
    'projection': 'projection_matrix',
}
NAMED = 5  # of the cameras of a file, in a message


class _Loader(yaml.SafeLoader):
    """Loader that takes what a tag marks for what it is: OpenCV's matrices are mappings."""


def _without_tag(loader: _Loader, tag: str, node: Any) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_Loader.add_multi_constructor('', _without_tag)


def document_of(text: str) -> Any:
    """
    Return the document in a text, the first where a console has printed several.

    Raises ValueError if it cannot be parsed.
    """
    start = text.lstrip()
    try:
        if start.startswith('<'):
            return _of_xml(ElementTree.fromstring(start))
        if re.search(r'^\[image\]', text, re.MULTILINE):
            return _of_ost(text)
        lines = (line for line in text.splitlines(keepends=True) if not line.startswith('%'))
        chunks = re.split(r'^---(?:\s|$)', ''.join(lines), flags=re.MULTILINE)
        return yaml.load(next(filter(str.strip, chunks), ''), _Loader)
    except ElementTree.ParseError as error:
        raise ValueError(f'camera file is not XML: {error}') from None
    except yaml.YAMLError as error:
        problem, mark = getattr(error, 'problem', None), getattr(error, 'problem_mark', None)
        where = '' if mark is None else f' in line {mark.line + 1}'
        problem = problem or 'it cannot be read'
        raise ValueError(f'camera file is not YAML: {problem}{where}') from None
    except (ValueError, AttributeError):  # of a date, or a number of too many digits
        raise ValueError('camera file is not YAML: it has a value that cannot be read') from None
    except RecursionError:
        raise ValueError('camera file is nested too deeply') from None


def _of_xml(element: ElementTree.Element) -> Any:
    """Return an element as in OpenCV's FileStorage: children by name, or a text."""
    if len(element):
        return {child.tag: _of_xml(child) for child in element}
    return (element.text or '').strip().strip('"')


def _of_ost(text: str) -> dict[str, Any]:
    """Return the camera of an ost.txt: titles, each with its numbers below."""
    document, key = dict[str, Any](), ''
    for line in map(str.strip, text.splitlines()):
        if line in OST_KEYS:
            key = OST_KEYS[line]
            if key in document:
                return {}  # a second camera
            document[key] = ''
        elif line[:1].isalpha() and line.split()[0] not in ('nan', 'inf') or line[:1] in '[#':
            key = key if not line else ''
        elif key:
            document[key] = f'{document[key]} {line}'.strip()
    return document


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
    document = document_of(text.removeprefix('\ufeff'))  # as editors of Windows begin a file
    calibration = _with_size(_chosen(document, name), size)
    if rectified and not calibration.p:
        raise ValueError(
            "camera file lacks 'projection_matrix', which rectified images need; write it with "
            'camera_calibration'
        )
    return read.camera(calibration, rectified=rectified, cropped=cropped)


def from_document(document: Any) -> CameraModel:
    """Return the camera of a parsed file that was written for images that were used."""
    return read.camera(_with_size(_chosen(document, ''), None), cropped=True)


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


def _chosen(document: Any, name: str) -> Calibration:
    """Return the calibration of ``name``, or of the only camera that there is."""
    cameras: Cameras = {}
    if isinstance(document, Mapping):
        cameras = of_kalibr(document) or by_keys(document)
    if not cameras:
        raise ValueError(
            f"camera file lacks 'camera_matrix' of one camera; supported are {KINDS}. Of another "
            f'program, {BY_HAND}; of COLMAP and nerfstudio cx - 0.5 and cy - 0.5'
        )
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
