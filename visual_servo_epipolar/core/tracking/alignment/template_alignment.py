"""
Template alignment: feature patches aligned with the desired image, so that nothing drifts.

Inverse-compositional affine alignment (Baker and Matthews 2004) of all features at once, blind to
gain and bias of the light.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image
from visual_servo_epipolar.core.tracking.alignment.sampling import (
    affine_maps,
    FloatImage,
    patch_radius,
    PatchGrid,
    RADIUS,
)
from visual_servo_epipolar.core.tracking.alignment.templates import (
    levels_of,
    PARAMETERS,
    SCALES,
    Templates,
)
from visual_servo_epipolar.core.tracking.alignment.warps import squared_lengths, Warps

FIRST_ITERATIONS = 15  # after a match: its scale is only known by SIFT
MAX_CORRECTION = 4.0  # of one alignment from the position by flow or matching [px]
LEAST_SCALE = 1e-3  # determinant below which a step of the alignment is not taken
CONVERGED = 0.02  # motion by a step after which none follows [px]
AFFINE_REACH = 0.5  # of the radius: where the motion by its linear part is judged
ADJUGATE, ADJUGATE_SIGNS = np.array([5, 3, 4, 2]), np.array([1.0, -1.0, -1.0, 1.0])
IDENTITY = np.array([1.0, 0.0, 0.0, 1.0])


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
        self._reaches = np.array([1.0, 1.0, *[AFFINE_REACH * self.radius] * 4])
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
    inverse = step.take(ADJUGATE, axis=1)
    inverse *= ADJUGATE_SIGNS
    inverse += IDENTITY  # the adjugate yet
    scale = inverse[:, 0] * inverse[:, 3] - inverse[:, 1] * inverse[:, 2]
    inverse /= scale[:, None]
    is_taken = np.abs(scale) >= LEAST_SCALE
    if not is_taken.all():  # a diverging step is not
        inverse[~is_taken] = IDENTITY
    composed = np.empty_like(maps)
    composed[:, :, :2] = linear = maps[:, :, :2] @ inverse.reshape(-1, 2, 2)
    composed[:, :, 2] = maps[:, :, 2] - (linear @ step[:, :2, None])[:, :, 0]
    return composed
