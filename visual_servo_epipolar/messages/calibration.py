"""Calibrations: documents with a camera matrix, by the names of ROS, and Kalibr's camchain."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import math
from typing import Any, TypeAlias

from visual_servo_epipolar.core.cameras.registry import lens_name

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
    """
    What a file says of a camera, by the names of a CameraInfo.

    Width and height are 0 where it has none, which ``size_keys`` would tell; p is empty likewise.
    """

    width: int
    height: int
    k: tuple[float, ...]
    d: tuple[float, ...] = ()
    distortion_model: str = 'plumb_bob'
    p: tuple[float, ...] = ()
    binning_x: int = 0
    binning_y: int = 0
    roi: Region = Region()
    size_keys: str = 'image_width and image_height'


# The cameras of a document by name, each to be read when it is chosen.
Cameras: TypeAlias = Mapping[str, Callable[[], Calibration]]


def entry(document: Mapping[str, Any], key: str) -> Any:
    """Return what ``document`` has under ``key``, or raise ValueError."""
    if key not in document:
        raise ValueError(f'camera file lacks {key!r}')
    return document[key]


def numbers(value: Any, key: str, counts: Sequence[int] = ()) -> tuple[float, ...]:
    """Return numbers of a matrix, a list of them or of rows, or text; of one of ``counts``."""
    many = f'{" or ".join(map(str, counts))} numbers' if counts else 'numbers'
    expected = f'{key} must be a list of {many}'
    if isinstance(value, Mapping) and 'data' in value:
        value = value['data']
    if isinstance(value, str):
        value = value.split()
    if not isinstance(value, Sequence):
        raise ValueError(f'{expected}, got {as_text(value)}')
    if value and all(isinstance(row, list) and len(row) == len(value[0]) for row in value):
        value = [each for row in value for each in row]
    if counts and len(value) not in counts:
        raise ValueError(f'{expected}, got {len(value)}')
    return tuple(_number(each, key, expected) for each in value)


def whole_number(value: Any, key: str, low: int = 1, high: int = SIDE) -> int:
    """Return a whole number from ``low`` to ``high``, or raise ValueError."""
    expected = f'{key} must be a whole number from {low} to {high}'
    try:
        exact = isinstance(value, int) and not isinstance(value, bool)
        result = int(value) if exact else _number(value, key, expected)
    except ValueError:
        raise ValueError(f'{expected}, got {as_text(value)}') from None
    if not low <= result <= high or result != int(result):
        raise ValueError(f'{expected}, got {as_text(value)}')
    return int(result)


def text(value: Any, key: str) -> str:
    """Return a text, or raise ValueError."""
    if not isinstance(value, str):
        raise ValueError(f'{key} must be a name, got {as_text(value)}')
    return value


def as_text(value: Any) -> str:
    """Return what a user wrote, for messages."""
    if value is None:
        return 'nothing'
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, Mapping):
        keys = (key if isinstance(key, str) else as_text(key) for key in value)
        return f'the keys {", ".join(keys)}'[:60] if value else 'nothing'
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f'a list of {len(value)}'
    if isinstance(value, int) and abs(value) > LARGEST:
        return 'a number too large'
    return f'{value!r:.40}' if isinstance(value, str) else f'{value!s:.40}'


def _number(value: Any, key: str, expected: str) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError
        result = float(value)  # of text too: 1e3 is one in YAML 1.1
    except (OverflowError, ValueError):
        raise ValueError(f'{expected}, got {as_text(value)}') from None
    if not math.isfinite(result) or abs(result) > LARGEST:
        raise ValueError(f'{expected}, finite and below {LARGEST:g}, got {as_text(value)}')
    return result


# By the names of ROS, CameraInfo's of ROS 2 and ROS 1 among them, and of OpenCV's sample.
KEYS = {
    'width': ('image_width', 'width'),
    'height': ('image_height', 'height'),
    'matrix': ('camera_matrix', 'k', 'K'),
    'distortion': ('distortion_coefficients', 'd', 'D'),
    'projection': ('projection_matrix', 'p', 'P'),
}
BY_COUNT = {8: 'rational_polynomial', 12: 'rational_polynomial', 14: 'rational_polynomial'}


def by_keys(document: Mapping[str, Any]) -> Cameras:
    """Return the camera of a document that has a camera matrix, none of others."""
    if not any(key in document for key in KEYS['matrix']):
        return {}
    return {'': partial(_calibration, document)}


def _calibration(document: Mapping[str, Any]) -> Calibration:
    known = {*KEYS['distortion'], 'distortion_model'}
    for key in document:  # a slip would leave the distortion out
        if str(key).lower().startswith('dist') and key not in known:
            raise ValueError(
                f'{key} is not a key of camera files; rename it to distortion_coefficients'
            )
    found = {what: next((it for it in KEYS[what] if it in document), '') for what in KEYS}
    width, height = _size(document, found['width'], found['height'])
    distortion = document.get(found['distortion'], ())
    d = numbers(distortion, found['distortion'])
    projection = found['projection']
    return Calibration(
        width=width,
        height=height,
        k=numbers(document[found['matrix']], found['matrix'], (9,)),
        d=d,
        distortion_model=_lens(document, d),
        p=numbers(document[projection], projection, (12,)) if projection else (),
        binning_x=whole_number(document.get('binning_x', 0), 'binning_x', 0),
        binning_y=whole_number(document.get('binning_y', 0), 'binning_y', 0),
        roi=_region(document.get('roi', {})),
    )


def _size(document: Mapping[str, Any], width: str, height: str) -> tuple[int, int]:
    if not (width or height):
        return 0, 0
    if not (width and height):
        raise ValueError(f'camera file lacks {"image_height" if width else "image_width"!r}')
    return whole_number(document[width], width), whole_number(document[height], height)


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
        raise ValueError(f'roi must have x_offset, y_offset, width, height, got {as_text(roi)}')
    names = ('x_offset', 'y_offset', 'width', 'height')
    return Region(**{name: whole_number(roi.get(name, 0), f'roi.{name}', 0) for name in names})


KALIBR_LENSES = ('', 'plumb_bob', 'equidistant')  # none, radtan, equidistant, by ROS names
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
    if lens_name(name) not in KALIBR_LENSES:
        raise ValueError(
            f'{prefix}distortion_model must be radtan, equidistant or none, got {name!r:.40}; '
            f'{KALIBR_REMEDY}'
        )
    size, key = (0, 0), f'{prefix}resolution'
    if 'resolution' in camera:
        width, height = numbers(camera['resolution'], key, (2,))
        size = whole_number(width, key), whole_number(height, key)
    coefficients = 'distortion_coeffs' if 'distortion_coeffs' in camera else KEYS['distortion'][0]
    d = entry(camera, coefficients) if lens_name(name) else camera.get(coefficients, ())
    return Calibration(
        width=size[0],
        height=size[1],
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        d=numbers(d, f'{prefix}{coefficients}'),
        distortion_model=name,
        size_keys=key,
    )
