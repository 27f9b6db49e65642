"""
Template alignment: feature patches aligned with the desired image, so that nothing drifts.

Inverse-compositional affine alignment (Baker and Matthews 2004) of all features at once, blind to
gain and bias of the light. A template is the desired image blurred and sampled at the scale at
which the feature appears in the current one, so that both patches show equal detail.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.tracking.sampling import (
    affine_maps,
    float_image,
    FloatImage,
    patch_radius,
    PatchGrid,
    RADIUS,
)
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.warps import squared_lengths, Warps

FIRST_ITERATIONS = 15  # after a match: its scale is only known by SIFT
MAX_CORRECTION = 4.0  # of one alignment from the position by flow or matching [px]
LEAST_SCALE = 1e-3  # determinant below which a step of the alignment is not taken
CONVERGED = 0.02  # motion by a step after which none follows [px]
LEVELS_PER_OCTAVE = 2
LEVELS = 8  # down to 1 / 11 of the size in the desired image
SCALES = 2.0 ** (-np.arange(LEVELS) / LEVELS_PER_OCTAVE)  # of the current over the desired image
PIXEL_BLUR = 0.5  # standard deviation of what one pixel integrates over [px]
DAMPING = 1e-3  # of the Hessian, over its mean eigenvalue (Levenberg)
PARAMETERS = 6  # of an affine step: shift along x and y, then the linear part row by row
STACKS = 2  # kept, the last used: of the tracked features, and of those found anew
MOST = 2048  # templates kept, 25 MB: more than a run uses, but a robot may be up for weeks

Key = tuple[int, int]  # number of the feature, level


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Aligned ``warps`` with zero-mean correlation and residual [grey levels], shape (N,) each."""

    warps: Warps
    correlation: FloatArray
    residual: FloatArray


class Anchor:
    """
    Anchor: the desired image as a pyramid, with the templates of features at its levels.

    Patches have 2 ``radius`` + 1 pixels a side, at the scale of the current image.
    """

    def __init__(self, image: Image) -> None:
        self.radius = patch_radius(image.shape)
        self._grids = {self.radius: PatchGrid(self.radius)}
        self._grid = self._grids[self.radius]
        # Half way to the border the motion by the linear part is judged.
        self._reaches = np.array([1.0, 1.0, *[self.radius / 2] * 4])
        self._templates = Templates(image, self._grid)

    def patch(
        self, feature: int, point: FloatArray, affine: FloatArray
    ) -> tuple[FloatImage, FloatArray]:
        """
        Return the template at the scale of ``affine``, (2, 2), of the feature at ``point``, (2,).

        Shape (S, S), S = 2 radius + 1; and the map of its pixels to current offsets, (2, 2).
        """
        level = int(levels_of(affine[None])[0])
        patch = self._templates.patch(feature, point, level)
        return patch.reshape(2 * self.radius + 1, -1), affine / float(SCALES[level])

    def region(
        self, image: FloatImage, centre: FloatArray, local: FloatArray, reach: int
    ) -> FloatImage:
        """
        Return ``image`` around ``centre``, (2,) [px], resampled up to ``reach`` template pixels.

        Shape (2 reach + 1, 2 reach + 1); ``local``, (2, 2), maps template pixels to offsets.
        """
        if reach not in self._grids:
            self._grids[reach] = PatchGrid(reach)
        sampled = self._grids[reach].sample(image, affine_maps(local[None], centre[None]))
        return sampled.reshape(2 * reach + 1, -1)

    def align(self, warps: Warps, image: FloatImage, *, iterations: int) -> Alignment:
        """
        Align every feature of ``warps`` with its patch in the desired image.

        ``image`` is the current one, float32 of shape (H, W). At most ``iterations`` steps, none
        after one that has hardly moved. A patch without texture keeps its position and gets
        correlation 0, as does one that moves more than MAX_CORRECTION.
        """
        if not len(warps):
            return Alignment(warps, np.empty(0), np.empty(0))
        levels = levels_of(warps.affine)
        templates = self._templates.stacked(warps.ids, warps.desired, levels)
        scale = SCALES[levels][:, None, None]
        maps = affine_maps(warps.affine / scale, warps.current)
        correlation, deviation = self._descended(templates, image, maps, iterations)
        centre, affine = maps[:, :, 2].copy(), maps[:, :, :2] * scale
        correction = np.sqrt(squared_lengths(centre - warps.current))
        # A comparison with nan is false: what diverged stays where it was.
        stays = ~((correction <= MAX_CORRECTION) & np.isfinite(maps).all(axis=(1, 2)))
        if stays.any():
            correlation[stays] = 0.0
            centre[stays], affine[stays] = warps.current[stays], warps.affine[stays]
        residual = deviation * np.sqrt(np.maximum(2.0 - 2.0 * correlation, 0.0))
        aligned = Warps(warps.ids, warps.desired, centre, affine)
        return Alignment(aligned, correlation, residual)

    def _descended(
        self, templates: FloatImage, image: FloatImage, maps: FloatArray, iterations: int
    ) -> tuple[FloatArray, FloatArray]:
        """
        Move ``maps``, (N, 2, 3), from template to image in place to where the patches agree.

        Returns correlations and deviations, shape (N,), up to CONVERGED those of the end.
        """
        moving, current = np.arange(len(maps)), maps
        correlation, deviation = np.empty(len(maps)), np.empty(len(maps))
        with np.errstate(invalid='ignore', over='ignore', divide='ignore'):  # of what diverges
            for left in range(iterations, -1, -1):
                step, deviation[moving] = _compared(templates, self._grid.sample(image, current))
                correlation[moving] = step[:, PARAMETERS]
                if not left:
                    break
                maps[moving] = current = _composed(current, step)
                goes_on = self._moves(step)
                if not goes_on.all():
                    moving = moving[goes_on]
                    if not len(moving):
                        break
                    current, templates = current[goes_on], templates[goes_on]
        return correlation, deviation

    def _moves(self, step: FloatArray) -> BoolArray:
        """Return which of the steps, shape (N, 7), move a pixel of the patch noticeably, (N,)."""
        # In a small image there is little to average over: the last hundredths count.
        converged = CONVERGED if self.radius == RADIUS else 0.0
        still = np.abs(step[:, :PARAMETERS]) < converged / self._reaches
        return np.asarray(~still.all(axis=1))  # nan goes on, and is not taken in the end


def _compared(templates: FloatImage, patches: FloatImage) -> tuple[FloatArray, FloatArray]:
    """
    Return the step to take of each of ``patches``, (N, P), with the correlation, shape (N, 7).

    And their deviations, shape (N,) [grey levels]. ``patches`` are used up.
    """
    # The mean: numpy's own method takes as long again to be called.
    patches -= np.add.reduce(patches, axis=1, keepdims=True) / np.float32(patches.shape[1])
    norm = np.sqrt(np.einsum('np,np->n', patches, patches).astype(np.float64))
    # A template's own patch has no step: the product of the current one is that of the residual.
    product = (templates @ patches[:, :, None])[:, :, 0]
    step = product / np.where(norm > 0.0, norm, 1.0)[:, None]
    return step, norm / math.sqrt(patches.shape[1])


def _composed(maps: FloatArray, step: FloatArray) -> FloatArray:
    """Return W o dW^-1 of ``maps`` W, (N, 2, 3), and the steps dW, shape (N, 6) or more."""
    a, b, c, d = step[:, 2:PARAMETERS].T
    inverse = np.stack([1.0 + d, -b, -c, 1.0 + a], axis=1)  # the adjugate yet
    scale = inverse[:, 0] * inverse[:, 3] - inverse[:, 1] * inverse[:, 2]
    inverse /= scale[:, None]
    is_taken = np.abs(scale) >= LEAST_SCALE
    if not is_taken.all():  # a diverging step is not
        inverse[~is_taken] = np.eye(2).ravel()
    composed = np.empty_like(maps)
    composed[:, :, :2] = linear = maps[:, :, :2] @ inverse.reshape(-1, 2, 2)
    composed[:, :, 2] = maps[:, :, 2] - (linear @ step[:, :2, None])[:, :, 0]
    return composed


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
        # Room for the features that are usually tracked, doubled when it is taken.
        shape = TrackerSettings.max_features, PARAMETERS + 1, len(grid.offsets)
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
        if len(self._rows) + len(missing) > MOST:  # features have come and gone: begin anew
            self._rows.clear()
            self._stacks.clear()
            missing = list(range(len(keys)))
        for number in missing:
            row = len(self._rows)
            if row == len(self._stored):
                self._stored = np.concatenate([self._stored, np.empty_like(self._stored)])
            self._stored[row] = self._made(points[number], keys[number][1])
            self._rows[keys[number]] = row
        return [self._rows[key] for key in keys]

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
        # Of a patch of unit norm that is a ramp rounding is left.
        contrast /= max(math.sqrt(contrast @ contrast), float(np.finfo(patch.dtype).eps))
        descent -= (descent @ self._bias.T) @ self._bias
        descent -= (descent @ contrast)[:, None] * contrast
        descent *= self._scale
        hessian = descent @ descent.T
        trace = float(hessian.trace())
        if not trace > 0.0:  # stripes of a pixel: contrast without a slope
            return np.zeros(descent.shape, np.float32)
        hessian += DAMPING * trace / PARAMETERS * np.eye(PARAMETERS)
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
