"""
Templates: patches of the desired image, prepared once for each feature and scale.

A template is the desired image blurred and sampled at the scale at which the feature appears in
the current one, so that both patches show equal detail.
"""

from collections.abc import Sequence
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.core.tracking.alignment.sampling import (
    affine_maps,
    float_image,
    FloatImage,
    PatchGrid,
)

LEVELS_PER_OCTAVE = 2
LEVELS = 8  # down to 1 / 11 of the size in the desired image
SCALES = 2.0 ** (-np.arange(LEVELS) / LEVELS_PER_OCTAVE)  # of the current over the desired image
PIXEL_BLUR = 0.5  # standard deviation of what one pixel integrates over [px]
DAMPING = 1e-3  # of the Hessian, over its mean eigenvalue (Levenberg)
LEAST_CONTRAST = 1e-6  # of a patch of unit norm without its ramps: of a ramp nothing is left
PARAMETERS = 6  # of an affine step: shift along x and y, then the linear part row by row
IDENTITY = np.eye(PARAMETERS)
STACKS = 2  # kept, the last used: of the tracked features, and of those found anew
FIRST_CAPACITY = 64  # templates for which there is room, doubled when it is taken
MOST = 2048  # templates kept, 25 MB: more than a run uses, but a robot may be up for weeks

Key = tuple[int, int]  # number of the feature, level


class Templates:
    """
    Templates of the features of the desired image, at the levels of its pyramid.

    A template is an array of shape (7, P): the map of a residual patch to the six parameters of
    the step, H^-1 J^T, times its norm; and, last, the patch itself with zero mean and unit norm.
    """

    def __init__(self, image: Image, grid: PatchGrid) -> None:
        self._wide, self._descent = PatchGrid(grid.reach + 1), SteepestDescent(grid)
        self._images = [_blurred(image, level) for level in range(LEVELS)]
        self._rows: dict[Key, int] = {}
        shape = FIRST_CAPACITY, PARAMETERS + 1, len(grid.offsets)
        self._stored = np.empty(shape, np.float32)
        self._stacks: dict[bytes, tuple[list[int], FloatImage]] = {}

    def stacked(self, ids: IntArray, points: FloatArray, levels: IntArray) -> FloatImage:
        """
        Return the templates of features ``ids`` at ``points``, at ``levels``, shape (N, 7, P).

        Shapes (N,), (N, 2), (N,). Mostly they are those of the last frame, and already stacked.
        """
        wanted = ids.tobytes() + levels.tobytes()
        stack = self._stacks.pop(wanted, None)
        if stack is None:
            keys = list(zip(ids.tolist(), levels.tolist(), strict=True))
            rows = self._rows_of(keys, points)
            stack = rows, self._stored.take(rows, axis=0)
        self._stacks[wanted] = stack  # the last one
        if len(self._stacks) > STACKS:
            del self._stacks[next(iter(self._stacks))]
        return stack[1]

    def patch(self, feature: int, point: FloatArray, level: int) -> FloatImage:
        """Return the patch of the feature at ``point``, (2,), zero mean, unit norm, (P,)."""
        (row,) = self._rows_of([(feature, level)], point[None])  # which may move what is stored
        return np.asarray(self._stored[row, -1])

    def _rows_of(self, keys: Sequence[Key], points: FloatArray) -> list[int]:
        """Return the rows of templates, made where they are missing."""
        missing = [number for number, key in enumerate(keys) if key not in self._rows]
        if missing:
            self._make_room(len(missing), keys)
        for number in missing:
            row = len(self._rows)
            if row == len(self._stored):
                self._stored = np.concatenate([self._stored, np.empty_like(self._stored)])
            self._stored[row] = self._made(points[number], keys[number][1])
            self._rows[keys[number]] = row
        return [self._rows[key] for key in keys]

    def _make_room(self, count: int, keys: Sequence[Key]) -> None:
        """Drop what was not used lately, but none of ``keys``, where ``count`` are too many."""
        if len(self._rows) + count <= MOST:
            return
        recent, wanted = {row for rows, _ in self._stacks.values() for row in rows}, set(keys)
        kept = {key: row for key, row in self._rows.items() if row in recent or key in wanted}
        self._stored[: len(kept)] = self._stored[list(kept.values())]
        self._rows = {key: number for number, key in enumerate(kept)}
        self._stacks.clear()

    def _made(self, point: FloatArray, level: int) -> FloatImage:
        stride = 1.0 / float(SCALES[level])
        map_ = affine_maps(stride * np.eye(2)[None], point[None])
        side = 2 * self._wide.reach + 1
        square = self._wide.sample(self._images[level], map_).reshape(side, side)
        patch, deviation = normalised(square[1:-1, 1:-1].reshape(1, -1))
        template = np.zeros((PARAMETERS + 1, patch.size), np.float32)
        if deviation[0] > 0.0:
            norm = float(deviation[0]) * np.sqrt(patch.size)
            template[:-1] = self._descent.update_matrix(square, patch[0], norm)
            template[-1] = patch[0]
        return template


class SteepestDescent:
    """Steepest descent of a patch: how its pixels change with the parameters of a step."""

    def __init__(self, grid: PatchGrid) -> None:
        self._x, self._y = np.ascontiguousarray(grid.offsets.T)
        bias = np.stack([np.ones_like(self._x), self._x, self._y])  # orthogonal on a square grid
        self._bias = bias / np.sqrt((bias * bias).sum(axis=1, keepdims=True))
        # One unit of each parameter moves pixels by one.
        self._scale = np.array([1.0, 1.0, *[1.0 / grid.offsets.max()] * 4])[:, None]

    def update_matrix(self, square: FloatImage, patch: FloatImage, norm: float) -> FloatImage:
        """
        Return the map of a unit residual patch to the six parameters, H^-1 J^T, shape (6, P).

        Of ``patch``, (P,), with ``norm``, from a ``square`` that is one pixel wider.
        """
        slope_x = (0.5 * (square[1:-1, 2:] - square[1:-1, :-2])).ravel().astype(np.float64)
        slope_y = (0.5 * (square[2:, 1:-1] - square[:-2, 1:-1])).ravel().astype(np.float64)
        descent = np.empty((PARAMETERS, patch.size))
        descent[0], descent[1] = slope_x, slope_y
        rest = iter(descent[2:])
        for slope in (slope_x, slope_y):
            for offset in (self._x, self._y):
                np.multiply(slope, offset, out=next(rest))
        # Light must not look like motion: its bias, one that grows across the patch, as where it
        # comes from another side, and its gain are projected out.
        contrast = patch.astype(np.float64)
        contrast -= (self._bias @ contrast) @ self._bias
        contrast /= max(math.sqrt(contrast @ contrast), LEAST_CONTRAST)
        descent -= (descent @ self._bias.T) @ self._bias
        descent -= (descent @ contrast)[:, None] * contrast
        descent *= self._scale
        hessian = descent @ descent.T
        trace = float(hessian.trace())
        if not trace > 0.0:  # stripes of a pixel: contrast without a slope
            return np.zeros(descent.shape, np.float32)
        hessian += DAMPING * trace / PARAMETERS * IDENTITY
        update = self._scale * (np.linalg.solve(hessian, descent) * norm)
        return np.asarray(update.astype(np.float32))


def levels_of(affine: FloatArray) -> IntArray:
    """Return the level of each ``affine`` map, (N, 2, 2): the nearest scale, never above one."""
    determinant = affine[:, 0, 0] * affine[:, 1, 1] - affine[:, 0, 1] * affine[:, 1, 0]
    scale = np.sqrt(np.maximum(np.abs(determinant), 1e-6))
    levels = np.rint(-LEVELS_PER_OCTAVE * np.log2(scale))
    return np.asarray(np.clip(levels, 0, LEVELS - 1), dtype=np.int64)


def normalised(patches: FloatImage) -> tuple[FloatImage, FloatArray]:
    """Return patches of zero mean and unit norm, shape (N, P), and their deviations, (N,)."""
    centred = patches - patches.mean(axis=-1, keepdims=True)
    norm = np.sqrt(np.einsum('np,np->n', centred, centred))
    centred /= np.where(norm > 0.0, norm, 1.0)[:, None]
    return centred, norm.astype(np.float64) / np.sqrt(patches.shape[-1])


def _blurred(image: Image, level: int) -> FloatImage:
    """Return ``image`` as float32, blurred as a view at the scale of ``level``."""
    enlargement = 1.0 / float(SCALES[level])
    deviation = PIXEL_BLUR * np.sqrt(enlargement**2 - 1.0)
    if deviation == 0.0:
        return float_image(image)
    return np.asarray(cv2.GaussianBlur(float_image(image), (0, 0), float(deviation)))
