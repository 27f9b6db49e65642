"""Cameras by the names that CameraInfo and calibration files give their lenses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, ROUNDING
from visual_servo_epipolar.core.cameras import equidistant, equirectangular, pinhole
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.registry import Registry

CameraFactory: TypeAlias = Callable[..., CameraModel]


@dataclass(frozen=True, slots=True)
class CameraRow:
    """
    Row of a camera: its constructor, and how many ``coefficients`` its lens may have.

    ``factory`` takes width, height, fx, fy, cx, cy [px], the coefficients and the name of the
    lens, and ``skew`` by keyword. Where the size of the image tells all, ``of_size`` makes it from
    width and height [px], and no K is asked for.
    """

    factory: CameraFactory
    coefficients: tuple[int, ...] = (0,)
    of_size: Callable[[int, int], CameraModel] | None = None


CAMERAS: Registry[CameraRow] = Registry(
    'visual_servo_epipolar.cameras',
    {
        **{
            name: CameraRow(pinhole.Camera, counts)
            for name, counts in pinhole.DISTORTION_MODELS.items()
        },
        'equidistant': CameraRow(equidistant.Equidistant, equidistant.COEFFICIENTS),
        'equirectangular': CameraRow(
            equirectangular.Equirectangular, of_size=equirectangular.of_size
        ),
    },
    CameraRow,
)
UNKNOWN = CameraRow(pinhole.Camera)  # refuses the name
CAMERA_INFO = 'camera_info'  # the projection that is calibrated, not given
ZERO_PX = 1e-6  # what rounding leaves where K has a zero, in its last row of a ROUNDING
# Names of the same lenses: of drivers, of Kalibr and of Apex.AI's and Intel's models.
SYNONYMS = {
    'none': '',
    'radtan': 'plumb_bob',
    'radial-tangential': 'plumb_bob',
    'brown_conrady': 'plumb_bob',
    'fisheye': 'equidistant',
    'equi': 'equidistant',
    'kannala_brandt4': 'equidistant',
    'equirectangular_stitched': 'equirectangular',  # of routes and files of 0.1
}


def lens_name(distortion_model: str) -> str:
    """Return the name that CameraInfo has for a lens, '' for none; as it is if it is unknown."""
    name = distortion_model.strip().lower()
    return SYNONYMS.get(name, name)


def calibrated_camera(
    size: tuple[int, int],
    k: Sequence[float],
    distortion: tuple[float, ...] = (),
    distortion_model: str = 'plumb_bob',
) -> CameraModel:
    """
    Return the camera of an image ``size`` [px], K by rows (nine numbers) and a named lens.

    Zeros beyond the coefficients of the lens are left out. Of a panorama that was cut above and
    below, K tells the row of the horizon.

    Raises
    ------
    ValueError
        If there is no such camera.

    """
    name = lens_name(distortion_model)
    row = CAMERAS[name] if name in CAMERAS else UNKNOWN
    if row.of_size is not None:
        camera = row.of_size(*size)
        if isinstance(camera, equirectangular.Equirectangular):
            return camera.with_horizon(k[0], k[5])
        return camera
    (fx, skew, cx), (_, fy, cy), _ = checked_matrix(k).tolist()
    kept = _fitting(distortion, row.coefficients)
    return row.factory(*size, fx, fy, cx, cy, kept, name, skew=skew)


def checked_matrix(numbers: Sequence[float], name: str = 'K') -> FloatArray:
    """
    Return the three columns of K (nine numbers by rows) or P (twelve) that make pixels, (3, 3).

    Rows are (fx, s, cx), (0, fy, cy), (0, 0, 1) up to a common factor, which is divided out.

    Raises
    ------
    ValueError
        If they are not, as in a matrix that is written by columns.

    """
    rows = np.array(numbers, dtype=np.float64).reshape(3, -1)
    if not np.isfinite(rows).all():
        raise ValueError(f'intrinsics must be finite, {name} is {rows.tolist()}; calibrate')
    if not rows.any():  # an uncalibrated camera
        return rows[:, :3]
    matrix = _normalised(rows)
    if matrix is not None:
        return matrix
    values = ', '.join(f'{value:g}' for value in numbers)
    expected = '(fx, s, cx), (0, fy, cy), (0, 0, 1)'
    if _normalised(rows.reshape(-1, 3).T) is not None:
        raise ValueError(
            f'{name} is transposed: its rows must be {expected}, got {values}, which are its '
            f'columns; write {name} row by row'
        )
    raise ValueError(
        f'the rows of {name} must be {expected}, got {values}; calibrate, or mend its writer'
    )


def _normalised(rows: FloatArray) -> FloatArray | None:
    """Return the left part of ``rows``, (3, 3), with a last row 0, 0, 1; None if it has none."""
    if abs(rows[2, 2]) <= ROUNDING * np.abs(rows).max():
        return None
    rows = rows / rows[2, 2]
    last = np.abs(np.delete(rows[2], 2))
    is_whole = abs(rows[1, 0]) <= ZERO_PX and last.max() <= ROUNDING
    return rows[:, :3] if is_whole else None


def camera_of_size(projection: str, size: tuple[int, int]) -> CameraModel:
    """Return the camera of a ``projection`` that an image ``size`` [px] tells; else ValueError."""
    name = lens_name(projection)
    row = CAMERAS[name] if name in CAMERAS else UNKNOWN
    if row.of_size is None:
        known = [name for name in CAMERAS if CAMERAS[name].of_size is not None]
        raise ValueError(
            f'projection must be one of {", ".join([CAMERA_INFO, *known])}, got '
            f'{projection!r:.40}; leave a lens that needs a calibration to {CAMERA_INFO}'
        )
    return row.of_size(*size)


def scaled(
    camera: CameraModel, size: tuple[int, int], scale_u: float, scale_v: float
) -> CameraModel:
    """Return the camera of its image scaled to ``size`` [px], by these factors along u and v."""
    return with_intrinsics(
        camera,
        width=size[0],
        height=size[1],
        fx=camera.fx * scale_u,
        skew=camera.skew * scale_u,
        fy=camera.fy * scale_v,
        # Pixel centres are integers: the left border of the image lies at -0.5.
        cx=(camera.cx + 0.5) * scale_u - 0.5,
        cy=(camera.cy + 0.5) * scale_v - 0.5,
    )


def with_intrinsics(camera: CameraModel, **changes: Any) -> CameraModel:
    """Return the lens with ``changes`` of width, height, fx, fy, cx, cy, skew or distortion."""
    names = ('width', 'height', 'fx', 'fy', 'cx', 'cy')
    numbers = [changes.get(name, getattr(camera, name)) for name in names]
    skew = changes.get('skew', camera.skew)
    lens = changes.get('distortion', camera.distortion), camera.distortion_model
    return CAMERAS[camera.distortion_model].factory(*numbers, *lens, skew=skew)


def _fitting(distortion: tuple[float, ...], counts: Sequence[int]) -> tuple[float, ...]:
    """Return ``distortion`` without the zeros beyond the most coefficients that are allowed."""
    fitting = [n for n in counts if n <= len(distortion) and not any(distortion[n:])]
    return distortion[: max(fitting)] if fitting else distortion
