"""LAPACK for one small system: as numpy calls it, without checks that take longer than it does."""

from collections.abc import Callable
import math
from typing import TypeAlias

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray

Call: TypeAlias = Callable[..., FloatArray]

# A private module, of numpy 1.26 to 2.4 at least; without it numpy's own functions do the same.
_CALLS = getattr(np.linalg, '_umath_linalg', None)
_SOLVE1: Call = getattr(_CALLS, 'solve1', np.linalg.solve)
_SOLVE: Call = getattr(_CALLS, 'solve', np.linalg.solve)
_INVERSE: Call = getattr(_CALLS, 'inv', np.linalg.inv)


def solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """
    Return what ``np.linalg.solve`` does of one ``matrix``, (D, D), and (D,) or (D, C).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.

    """
    solution = (_SOLVE1 if right.ndim == 1 else _SOLVE)(matrix, right)
    if math.isnan(solution.item(0)):  # numpy will say why
        return np.asarray(np.linalg.solve(matrix, right))
    return solution


def inverse(matrix: FloatArray) -> FloatArray:
    """Return what ``np.linalg.inv`` does of one ``matrix``, (D, D), with the same errors."""
    inverted = _INVERSE(matrix)
    if math.isnan(inverted.item(0)):
        return np.asarray(np.linalg.inv(matrix))
    return inverted
