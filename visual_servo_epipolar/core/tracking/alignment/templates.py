"""
Templates: patches of the desired image, prepared once for each feature and scale.

A template is the desired image blurred and sampled at the scale at which the feature appears in
the current one, so that both patches show equal detail.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.core.tracking.alignment.sampling import (
    float_image,
    FloatImage,
    PatchGrid,
)

LEVELS_PER_OCTAVE = 2
LEVELS = 8  # down to 1 / 11 of the size in the desired image
PIXEL_BLUR = 0.5  # standard deviation of what one pixel integrates over [px]
DAMPING = 1e-3  # of the Hessian, over its mean eigenvalue (Levenberg)
PARAMETERS = 6  # of an affine step: shift along x and y, then the linear part row by row
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
        self._grid, self._wide = grid, PatchGrid(grid.reach + 1)
        self._images = [_blurred(image, level) for level in range(LEVELS)]
        self._rows: dict[Key, int] = {}
        shape = FIRST_CAPACITY, PARAMETERS + 1, len(grid.offsets)
        self._stored = np.empty(shape, np.float32)
        self._stacks: dict[tuple[int, ...], FloatImage] = {}

    def stacked(self, ids: IntArray, points: FloatArray, levels: IntArray) -> FloatImage:
        """
        Return the templates of features ``ids`` at ``points``, at ``levels``, shape (N, 7, P).

        Shapes (N,), (N, 2), (N,). Mostly they are those of the last frame, and already stacked.
        """
        keys = list(zip(ids.tolist(), levels.tolist(), strict=True))
        missing = [number for number, key in enumerate(keys) if key not in self._rows]
        self._make_room(len(missing), keys)
        for number in missing:
            self._add(keys[number], points[number])
        chosen = tuple(self._rows[key] for key in keys)
        stack = self._stacks.pop(chosen, None)
        self._stacks[chosen] = self._stored[list(chosen)] if stack is None else stack
        if len(self._stacks) > STACKS:
            del self._stacks[next(iter(self._stacks))]  # the oldest
        return self._stacks[chosen]

    def patch(self, feature: int, point: FloatArray, level: int) -> FloatImage:
        """Return the patch of the feature at ``point``, (2,), zero mean, unit norm, (P,)."""
        key = feature, level
        if key not in self._rows:
            self._make_room(1, [key])
            self._add(key, point)
        return np.asarray(self._stored[self._rows[key], -1])

    def _make_room(self, count: int, keys: Sequence[Key]) -> None:
        """Drop what was not used lately, but none of ``keys``, where ``count`` are too many."""
        if not count or len(self._rows) + count <= MOST:
            return
        recent, wanted = {row for chosen in self._stacks for row in chosen}, set(keys)
        kept = {key: row for key, row in self._rows.items() if row in recent or key in wanted}
        self._stored[: len(kept)] = self._stored[list(kept.values())]
        self._rows = {key: number for number, key in enumerate(kept)}
        self._stacks.clear()

    def _add(self, key: tuple[int, int], point: FloatArray) -> None:
        row = len(self._rows)
        if row == len(self._stored):
            self._stored = np.concatenate([self._stored, np.empty_like(self._stored)])
        self._stored[row], self._rows[key] = self._made(point, key[1]), row

    def _made(self, point: FloatArray, level: int) -> FloatImage:
        stride = 1.0 / float(scales(np.array([level]))[0])
        wide = self._wide.sample(self._images[level], point[None], stride * np.eye(2)[None])
        side = 2 * self._wide.reach + 1
        square = wide.reshape(side, side)
        patch, deviation = normalised(square[1:-1, 1:-1].reshape(1, -1))
        template = np.zeros((PARAMETERS + 1, patch.size), np.float32)
        if deviation[0] > 0.0:
            norm = float(deviation[0]) * np.sqrt(patch.size)
            update = _update_matrix(_slopes(square), self._grid.offsets, patch[0], norm)
            template[:-1], template[-1] = update, patch[0]
        return template


def scales(levels: IntArray) -> FloatArray:
    """Return the size in the current over that in the desired image at ``levels``, (N,)."""
    return np.asarray(2.0 ** (-levels / LEVELS_PER_OCTAVE))


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
    enlargement = 1.0 / float(scales(np.array([level]))[0])
    deviation = PIXEL_BLUR * np.sqrt(enlargement**2 - 1.0)
    if deviation == 0.0:
        return float_image(image)
    return np.asarray(cv2.GaussianBlur(float_image(image), (0, 0), float(deviation)))


def _slopes(square: FloatImage) -> FloatArray:
    """Return the derivatives of a patch along x and y, (2, P), of ``square`` one pixel wider."""
    along_x = square[1:-1, 2:] - square[1:-1, :-2]
    along_y = square[2:, 1:-1] - square[:-2, 1:-1]
    return np.asarray(0.5 * np.stack([along_x.ravel(), along_y.ravel()]), dtype=np.float64)


def _update_matrix(
    slope: FloatArray, grid: FloatArray, patch: FloatImage, norm: float
) -> FloatImage:
    """Return the map of a unit residual patch to the six parameters, H^-1 J^T, shape (6, P)."""
    x, y = grid.T
    descent = np.stack(
        [slope[0], slope[1], slope[0] * x, slope[0] * y, slope[1] * x, slope[1] * y]
    )
    # Gain and bias of the light must not look like motion: project both out.
    descent -= descent.mean(axis=1, keepdims=True)
    descent -= np.outer(descent @ patch, patch)
    scale = np.array([1.0, 1.0, *[1.0 / grid.max()] * 4])  # one unit each moves pixels by one
    descent = descent * scale[:, None]
    hessian = descent @ descent.T
    if not np.trace(hessian) > 0.0:  # stripes of a pixel: contrast without a slope
        return np.zeros((6, len(grid)), np.float32)
    hessian += DAMPING * np.trace(hessian) / 6.0 * np.eye(6)
    update = scale[:, None] * (np.linalg.solve(hessian, descent) * norm)
    return np.asarray(update.astype(np.float32))
