"""Files with a camera matrix: camera_calibration, camera_info on a console, OpenCV FileStorage."""

from collections.abc import Mapping
from functools import partial
import re
from typing import Any

from visual_servo_epipolar.core.cameras.registry import lens_name
from visual_servo_epipolar.messages.calibrations.calibration import (
    as_text,
    Calibration,
    Cameras,
    numbers,
    Region,
    text,
    whole_number,
)

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


def cameras(document: Mapping[str, Any]) -> Cameras:
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
