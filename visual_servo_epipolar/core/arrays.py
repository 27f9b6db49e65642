"""Array types and the checks made once, at the public door."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
ComplexArray: TypeAlias = NDArray[np.complex128]
Image: TypeAlias = NDArray[np.uint8]


def as_points(points: Any, name: str) -> FloatArray:
    """Return ``points`` as finite float64 of shape (N, 2), or raise ValueError naming it."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(
            f'{name} must have shape (N, 2), got {array.shape}; '
            'pass one row (u, v) or (x, y) a point'
        )
    if not np.isfinite(array).all():
        bad = int((~np.isfinite(array).all(axis=1)).sum())
        raise ValueError(f'{name} must be finite, got {bad} rows with NaN or inf; drop them')
    return array


TINY = 1e-30  # that is added to what is divided by
ROUNDING = 1e-9  # of lengths [m], angles [rad] and ratios
NORMAL = 1.4826  # standard deviation over the median of absolute values of normal noise


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy of ``array``."""
    copy = array.copy()
    copy.flags.writeable = False
    return copy


def packed(array: NDArray[Any]) -> NDArray[Any]:
    """
    Return ``array`` without gaps, for functions that are not rounded the same way everywhere.

    numpy 1 computes arctan2, exp, log, power and others of a column (a view with gaps) otherwise
    where the result happens to lie right behind it in memory, with other last bits: a seed would
    not give the same run.
    """
    return np.asarray(array, order='C')


def are_among(ids: IntArray, others: IntArray) -> BoolArray:
    """Return which of ``ids``, shape (N,), are among ``others``, (M,): a quarter of np.isin."""
    if not len(others):
        return np.zeros(len(ids), bool)
    ascending = np.sort(others)
    places = np.minimum(np.searchsorted(ascending, ids), len(ascending) - 1)
    return np.asarray(ascending[places] == ids)


def medians(values: FloatArray) -> FloatArray:
    """Return the median of ``values``, shape (..., N), along the last axis: (...,); no nan."""
    ordered = values.copy()
    ordered.sort()
    count = values.shape[-1]
    return np.asarray(0.5 * (ordered[..., (count - 1) // 2] + ordered[..., count // 2]))


def median(values: FloatArray) -> float:
    """Return the median of at least one of ``values``, shape (N,), none of them nan."""
    return float(medians(values))


def as_gray(image: Any, name: str = 'image') -> Image:
    """Return ``image`` as contiguous uint8 of shape (H, W), or raise ValueError naming it."""
    array = np.asarray(image)
    if array.dtype != np.uint8 or array.ndim != 2 or 0 in array.shape:
        raise ValueError(
            f'{name} must be a non-empty uint8 array of shape (H, W), got {array.dtype} of shape '
            f'{array.shape}; convert it to one grey channel of 8 bits'
        )
    return np.ascontiguousarray(array)
