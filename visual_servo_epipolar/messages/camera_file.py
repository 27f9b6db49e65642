"""Camera files: calibrations of ROS, OpenCV and Kalibr, and back."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import re
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np
import yaml

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import lens_name
from visual_servo_epipolar.core.errors import listed
from visual_servo_epipolar.files import yaml_document
from visual_servo_epipolar.messages import read

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
SIDE, LARGEST = 100_000, 1e9  # of images [px], and of any number in a calibration


@dataclass(frozen=True, kw_only=True)
class Region:
    """The region of interest, all zeros where the image is whole."""

    x_offset: int = 0
    y_offset: int = 0
    width: int = 0
    height: int = 0


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a file says of a camera, by the names of a CameraInfo; p is empty where it has none."""

    width: int
    height: int
    k: tuple[float, ...]
    d: tuple[float, ...] = ()
    distortion_model: str = 'plumb_bob'
    p: tuple[float, ...] = ()
    binning_x: int = 0
    binning_y: int = 0
    roi: Region = Region()


# The cameras of a document by name, each to be read when it is chosen.
Cameras: TypeAlias = Mapping[str, Callable[[], Calibration]]


def from_text(
    text: str,
    *,
    name: str = '',
    rectified: bool = False,
    cropped: bool = False,
) -> CameraModel:
    """
    Return the camera of a file, that of ``name`` where it has several.

    Of ``rectified`` images projection_matrix alone holds; those that are ``cropped`` have their
    principal point anywhere.

    Raises ValueError if the file is none of KINDS, lacks something, or is of no camera that
    can be used.
    """
    document = document_of(text.removeprefix('\ufeff'))  # as editors of Windows begin a file
    calibration = _chosen(document, name)
    if rectified and not calibration.p:
        raise ValueError(
            "camera file lacks 'projection_matrix', which rectified images need; write it with "
            'camera_calibration'
        )
    return read.camera(calibration, rectified=rectified, cropped=cropped)


def from_document(document: Any) -> CameraModel:
    """Return the camera of a parsed file that was written for images that were used."""
    return read.camera(_chosen(document, ''), cropped=True)


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
        cameras = of_kalibr(document)
        if not cameras and any(key in document for key in KEYS['matrix']):
            cameras = {'': partial(_calibration, document)}
    if not cameras:
        raise ValueError(
            f"camera file lacks 'camera_matrix' of one camera; supported are {KINDS}. Of another "
            f'program, {BY_HAND}; of COLMAP and nerfstudio cx - 0.5 and cy - 0.5'
        )
    if name not in cameras and (name or len(cameras) > 1):
        raise ValueError(
            f'the file has the cameras {listed([*cameras])}, got '
            f'{name or "no name"}; choose one, as in FILE#{next(iter(cameras))}'
        )
    return cameras[name or next(iter(cameras))]()


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
        return yaml_document(next(filter(str.strip, chunks), ''), _Loader)
    except ElementTree.ParseError as error:
        raise ValueError(f'camera file is not XML: {error}') from None
    except ValueError as error:
        raise ValueError(f'camera file is not YAML: {error}') from None


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


def numbers(value: Any, key: str, counts: Sequence[int] = ()) -> tuple[float, ...]:
    """Return numbers of a matrix, a list of them or of rows, or text; of one of ``counts``."""
    many = f'{" or ".join(map(str, counts))} numbers' if counts else 'numbers'
    rows = value['data'] if isinstance(value, Mapping) and 'data' in value else value
    rows = rows.split() if isinstance(rows, str) else rows
    try:
        found = np.array(rows, dtype=np.float64).ravel()  # of text too: 1e3 is one in YAML 1.1
        if isinstance(rows, Mapping) or rows is None or counts and len(found) not in counts:
            raise ValueError
        if not (np.abs(found) <= LARGEST).all():
            raise ValueError
    except (OverflowError, TypeError, ValueError):
        raise ValueError(
            f'{key} must be a list of {many}, finite and below {LARGEST:g}, got {value!r:.60}'
        ) from None
    return tuple(found.tolist())


def whole_number(value: Any, key: str, low: int = 1, high: int = SIDE) -> int:
    """Return a whole number from ``low`` to ``high``, or raise ValueError."""
    try:
        if isinstance(value, bool) or int(value) != float(value) or not low <= int(value) <= high:
            raise ValueError
    except (OverflowError, TypeError, ValueError):
        raise ValueError(
            f'{key} must be a whole number from {low} to {high}, got {value!r:.40}'
        ) from None
    return int(value)


def text(value: Any, key: str) -> str:
    """Return a text, or raise ValueError."""
    if not isinstance(value, str):
        raise ValueError(f'{key} must be a name, got {value!r:.40}')
    return value


# By the names of ROS, CameraInfo's of ROS 2 and ROS 1 among them, and of OpenCV's sample.
KEYS = {
    'width': ('image_width', 'width'),
    'height': ('image_height', 'height'),
    'matrix': ('camera_matrix', 'k', 'K'),
    'distortion': ('distortion_coefficients', 'd', 'D'),
    'projection': ('projection_matrix', 'p', 'P'),
}
BY_COUNT = {8: 'rational_polynomial', 12: 'rational_polynomial', 14: 'rational_polynomial'}


def _calibration(document: Mapping[str, Any]) -> Calibration:
    known = {*KEYS['distortion'], 'distortion_model'}
    for key in document:  # a slip would leave the distortion out
        if str(key).lower().startswith('dist') and key not in known:
            raise ValueError(
                f'{key} is not a key of camera files; rename it to distortion_coefficients'
            )
    found = {what: next((it for it in KEYS[what] if it in document), '') for what in KEYS}
    for side in ('width', 'height'):
        if not found[side]:
            raise ValueError(f"camera file lacks 'image_{side}'; add the image size to it")
    distortion = document.get(found['distortion'], ())
    d = numbers(distortion, found['distortion'])
    projection = found['projection']
    return Calibration(
        width=whole_number(document[found['width']], found['width']),
        height=whole_number(document[found['height']], found['height']),
        k=numbers(document[found['matrix']], found['matrix'], (9,)),
        d=d,
        distortion_model=_lens(document, d),
        p=numbers(document[projection], projection, (12,)) if projection else (),
        binning_x=whole_number(document.get('binning_x', 0), 'binning_x', 0),
        binning_y=whole_number(document.get('binning_y', 0), 'binning_y', 0),
        roi=_region(document.get('roi', {})),
    )


def _lens(document: Mapping[str, Any], distortion: tuple[float, ...]) -> str:
    """Return the name of the lens: that of the file, or the one of as many coefficients."""
    if 'distortion_model' in document:
        name = text(document['distortion_model'], 'distortion_model')
        return 'plumb_bob' if lens_name(name) == 'pinhole' else name
    fisheye = document.get('fisheye_model')
    if fisheye is not None and whole_number(fisheye, 'fisheye_model', 0):
        return 'equidistant'
    if len(distortion) == 4 and any(distortion) and fisheye is None:
        raise ValueError(
            '4 distortion_coefficients may be those of a pinhole or of a fisheye; add '
            'distortion_model plumb_bob or equidistant, or use ost.yaml instead of ost.txt'
        )
    return BY_COUNT.get(len(distortion), 'plumb_bob')


def _region(roi: Any) -> Region:
    if not isinstance(roi, Mapping):
        raise ValueError(f'roi must have x_offset, y_offset, width, height, got {roi!r:.40}')
    names = ('x_offset', 'y_offset', 'width', 'height')
    return Region(**{name: whole_number(roi.get(name, 0), f'roi.{name}', 0) for name in names})


KALIBR_REMEDY = 'calibrate with pinhole-radtan, or pinhole-equi for a fisheye'


def of_kalibr(document: Mapping[str, Any]) -> Cameras:
    """Return the cameras of Kalibr's camchain, or EuRoC's; none if it is no such document."""
    every = {f'{name}': camera for name, camera in document.items()} | {'': document}
    return {
        name: partial(_of_kalibr, camera, f'{name}.' if name else '')
        for name, camera in every.items()
        if isinstance(camera, Mapping) and {'camera_model', 'intrinsics'} <= camera.keys()
    }


def _of_kalibr(camera: Mapping[str, Any], prefix: str) -> Calibration:
    model = text(camera['camera_model'], f'{prefix}camera_model')
    if model != 'pinhole':
        raise ValueError(
            f'{prefix}camera_model must be pinhole, got {model!r:.40}: omni, ds and eucm are '
            f'other projections; {KALIBR_REMEDY}'
        )
    fx, fy, cx, cy = numbers(camera['intrinsics'], f'{prefix}intrinsics', (4,))
    name = text(camera.get('distortion_model', 'none'), f'{prefix}distortion_model')
    if lens_name(name) not in ('', 'plumb_bob', 'equidistant'):  # as ROS names them
        raise ValueError(
            f'{prefix}distortion_model must be radtan, equidistant or none, got {name!r:.40}; '
            f'{KALIBR_REMEDY}'
        )
    key = f'{prefix}resolution'
    width, height = numbers(camera.get('resolution'), key, (2,))
    coefficients = 'distortion_coeffs' if 'distortion_coeffs' in camera else KEYS['distortion'][0]
    d = camera.get(coefficients, None if lens_name(name) else ())
    return Calibration(
        width=whole_number(width, key),
        height=whole_number(height, key),
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        d=numbers(d, f'{prefix}{coefficients}'),
        distortion_model=name,
    )
