"""Cameras of calibrations: files with a camera matrix, Kalibr's camchain, EuRoC's sensor.yaml."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import math
import re
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
    """Return numbers of a matrix, (rows of) a list or text, of one of ``counts`` if any."""
    many = f'{" or ".join(map(str, counts))} numbers' if counts else 'numbers'
    expected = f'{key} must be a list of {many}'
    if isinstance(value, Mapping) and 'data' in value:
        value = value['data']
    if isinstance(value, str):
        value = value.split()
    if not isinstance(value, Sequence):
        raise ValueError(f'{expected}, got {as_text(value)}')
    if any(isinstance(row, Sequence) and not isinstance(row, str) for row in value):
        value = _flat(value, expected, is_matrix=bool(counts))
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


def _flat(value: Sequence[Any], expected: str, *, is_matrix: bool) -> list[Any]:
    """Return the rows, of one length, one after the other; of a vector there is one, or of one."""
    lengths = {len(row) if isinstance(row, Sequence) else 0 for row in value}
    if len(lengths) > 1 or any(isinstance(row, str) for row in value):
        raise ValueError(f'{expected}, got rows of different lengths')
    if not is_matrix and 1 not in {len(value), *lengths}:
        raise ValueError(f'{expected}, got {len(value)} rows of them')
    return [each for row in value for each in row]


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


# Keys without case and joints: of ROS first, then as OpenCV's samples and their users call them.
KEYS = {
    'width': ('imagewidth', 'width'),
    'height': ('imageheight', 'height'),
    'size': ('imagesize', 'resolution'),
    'matrix': ('cameramatrix', 'k', 'm', 'mtx', 'intrinsicmatrix', 'intrinsics'),
    'distortion': (
        *('distortioncoefficients', 'distcoeffs', 'distcoeff', 'distcoefs', 'distortioncoeffs'),
        *('distortion', 'dist', 'd'),
    ),
    'model': ('distortionmodel', 'cameramodel'),
    'projection': ('projectionmatrix', 'p'),
    'fisheye': ('fisheyemodel',),
}
OF_ONE = re.compile(r'(.+?)(\d+|left|right)')  # a key of one camera of several, as M1 or K_left
BY_COUNT = {5: 'plumb_bob', 8: 'rational_polynomial', 12: 'rational_polynomial'}
BY_COUNT |= {14: 'rational_polynomial', 0: 'plumb_bob'}


def cameras_by_keys(document: Mapping[str, Any]) -> Cameras:
    """Return the cameras of a document that has camera matrices, none if it has none."""
    keys = {_plain(key): key for key in document if isinstance(key, str)}
    names = [''] if any(name in keys for name in KEYS['matrix']) else []
    for plain, key in keys.items() if not names else ():
        match = OF_ONE.fullmatch(plain)
        if (
            match is not None
            and match[1] in KEYS['matrix']
            and not isinstance(document[key], int | float)
        ):
            names.append(match[2])
    return {name: partial(_calibration, document, keys, name) for name in names}


def _plain(key: str) -> str:
    return re.sub(r'[\W_]', '', key).lower()


def _calibration(document: Mapping[str, Any], keys: Mapping[str, str], name: str) -> Calibration:
    def find(what: str) -> tuple[str, Any]:
        """Return the key of this camera, or of all, and what it says; '' if there is none."""
        for plain in (*(each + name for each in KEYS[what]), *KEYS[what]):
            if plain in keys:
                return keys[plain], document[keys[plain]]
        return '', None

    _refuse_misspelt(keys)
    matrix_key, matrix = find('matrix')
    projection_key, projection = find('projection')
    width, height = _size(find)
    distortion_key, distortion = find('distortion')
    d = numbers(distortion, distortion_key) if distortion_key else ()
    return Calibration(
        width=width,
        height=height,
        k=numbers(matrix, matrix_key, (9,)),
        d=d,
        distortion_model=_lens(find, d),
        p=numbers(projection, projection_key, (12,)) if projection_key else (),
        binning_x=whole_number(document.get('binning_x', 0), 'binning_x', 0),
        binning_y=whole_number(document.get('binning_y', 0), 'binning_y', 0),
        roi=_region(document.get('roi', {})),
    )


def _refuse_misspelt(keys: Mapping[str, str]) -> None:
    """Raise ValueError where the distortion would be left out for a slip in its name."""
    known = {each for what in ('distortion', 'model') for each in KEYS[what]}
    for plain, key in keys.items():
        match = OF_ONE.fullmatch(plain)
        if (
            plain.startswith(('distort', 'distco'))
            and not {plain, match[1] if match else plain} & known
        ):
            raise ValueError(
                f'{key} is not a key of camera files; rename it to distortion_coefficients'
            )


def _size(find: Any) -> tuple[int, int]:
    (width_key, width), (height_key, height), (size_key, size) = map(
        find, ('width', 'height', 'size')
    )
    if size_key and not (width_key or height_key):
        width, height = numbers(size, size_key, (2,))
        width_key = height_key = size_key
    if not (width_key or height_key):
        return 0, 0
    if not (width_key and height_key):
        missing = 'image_height' if width_key else 'image_width'
        raise ValueError(f'camera file lacks {missing!r}')
    return whole_number(width, width_key), whole_number(height, height_key)


def _lens(find: Any, distortion: tuple[float, ...]) -> str:
    """Return the name of the lens: that of the file, or the one of as many coefficients."""
    (key, model), (fisheye_key, fisheye) = find('model'), find('fisheye')
    if key:
        name = text(model, key)
        return 'plumb_bob' if lens_name(name) == 'pinhole' else name
    if fisheye_key and whole_number(fisheye, fisheye_key, 0):
        return 'equidistant'
    if len(distortion) == 4 and any(distortion) and not fisheye_key:
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


def kalibr_cameras(document: Mapping[str, Any]) -> Cameras:
    """Return the cameras of Kalibr's camchain, or EuRoC's; none if it is no such document."""
    if _is_camera(document):
        return {'': partial(_of_kalibr, document, '')}
    return {
        str(name): partial(_of_kalibr, camera, f'{name}.')
        for name, camera in document.items()
        if _is_camera(camera)
    }


def _is_camera(value: Any) -> bool:
    return isinstance(value, Mapping) and {'camera_model', 'intrinsics'} <= value.keys()


def _of_kalibr(camera: Mapping[str, Any], prefix: str) -> Calibration:
    model = text(camera['camera_model'], f'{prefix}camera_model')
    if model != 'pinhole':
        raise ValueError(
            f'{prefix}camera_model must be pinhole, got {model!r:.40}: omni, ds and eucm are '
            'other projections; calibrate with pinhole-radtan, or pinhole-equi for a fisheye'
        )
    fx, fy, cx, cy = numbers(camera['intrinsics'], f'{prefix}intrinsics', (4,))
    name = text(camera.get('distortion_model', 'none'), f'{prefix}distortion_model')
    if lens_name(name) not in KALIBR_LENSES:
        raise ValueError(
            f'{prefix}distortion_model must be radtan, equidistant or none, got {name!r:.40}; '
            'calibrate with pinhole-radtan, or pinhole-equi for a fisheye'
        )
    width, height = _resolution(camera, prefix)
    key = 'distortion_coeffs' if 'distortion_coeffs' in camera else 'distortion_coefficients'
    coefficients = entry(camera, key) if lens_name(name) else camera.get(key, ())
    return Calibration(
        width=width,
        height=height,
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        d=numbers(coefficients, f'{prefix}{key}'),
        distortion_model=name,
        size_keys=f'{prefix}resolution',
    )


def _resolution(camera: Mapping[str, Any], prefix: str) -> tuple[int, int]:
    if 'resolution' not in camera:
        return 0, 0
    key = f'{prefix}resolution'
    width, height = numbers(camera['resolution'], key, (2,))
    return whole_number(width, key), whole_number(height, key)
