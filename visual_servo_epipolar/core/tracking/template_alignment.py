"""
Template alignment: feature patches aligned with the desired image, so that nothing drifts.

Inverse-compositional affine alignment (Baker and Matthews 2004) of all features at once, blind to
gain and bias of the light. A template is the desired image blurred and sampled at the scale at
which the feature appears in the current one, so that both patches show equal detail.
"""

from dataclasses import dataclass, replace
import math
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, IntArray

RADIUS, LEAST_RADIUS = 10, 6  # patches have 2 radius + 1 pixels a side
USUAL_SIZE = 640 * 480  # of an image: the radius shrinks with smaller ones [px]
LEVELS_PER_OCTAVE = 2
LEVELS = 8  # down to 1 / 11 of the size in the desired image
PIXEL_BLUR = 0.5  # standard deviation of what one pixel integrates over [px]
DAMPING = 1e-3  # of the Hessian, over its mean eigenvalue (Levenberg)
MAX_CORRECTION = 4.0  # of one alignment from the position by flow or matching [px]
LEAST_SCALE = 1e-3  # determinant below which a step of the alignment is not taken
FloatImage: TypeAlias = NDArray[np.float32]  # for interpolation, shape (H, W)


def patch_radius(shape: tuple[int, ...]) -> int:
    """
    Return the radius of patches [px] in images of ``shape`` (H, W).

    In a small image a patch of the usual side spans so much of the scene that it lies across
    edges in depth.
    """
    share = min(shape[0] * shape[1] / USUAL_SIZE, 1.0)
    return max(LEAST_RADIUS, round(RADIUS * math.sqrt(share)))


@dataclass(frozen=True, slots=True, eq=False)
class Warps:
    """
    Affine warps from the desired to the current image, rows are features.

    The point ``desired`` + xi appears at ``current`` + ``affine`` xi [px]. ``ids``, shape (N,);
    ``desired`` and ``current``, shape (N, 2); ``affine``, shape (N, 2, 2).
    """

    ids: IntArray
    desired: FloatArray
    current: FloatArray
    affine: FloatArray

    @classmethod
    def empty(cls) -> 'Warps':
        """Return the warps of no feature."""
        pixels = np.empty((0, 2))
        return cls(np.empty(0, np.int64), pixels, pixels, np.empty((0, 2, 2)))

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: IntArray | BoolArray) -> 'Warps':
        """Return the rows chosen by index, shape (M,), or mask, shape (N,)."""
        return Warps(self.ids[rows], self.desired[rows], self.current[rows], self.affine[rows])

    def joined(self, more: 'Warps') -> 'Warps':
        """Return these warps followed by ``more``."""
        return Warps(
            np.concatenate([self.ids, more.ids]),
            np.concatenate([self.desired, more.desired]),
            np.concatenate([self.current, more.current]),
            np.concatenate([self.affine, more.affine]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Aligned ``warps`` with zero-mean correlation and residual [grey levels], shape (N,) each."""

    warps: Warps
    correlation: FloatArray
    residual: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """Template of one feature at one scale: unit patch, shape (P,), and update matrix, (6, P)."""

    patch: FloatImage
    update: FloatImage


class Anchor:
    """
    Anchor: the desired image as a pyramid, with the templates of features at its levels.

    Patches have 2 ``radius`` + 1 pixels a side, at the scale of the current image.
    """

    def __init__(self, image: Image) -> None:
        self.radius = patch_radius(image.shape)
        self._images = [_blurred(image, level) for level in range(LEVELS)]
        self._templates: dict[tuple[int, int], _Template] = {}
        side = np.arange(-self.radius, self.radius + 1, dtype=np.float64)
        self._grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)  # rows: (x, y)
        homogeneous = np.column_stack([self._grid, np.ones(len(self._grid))])
        self._grid_rows = homogeneous.T.astype(np.float32)

    def patch(
        self, feature: int, point: FloatArray, affine: FloatArray
    ) -> tuple[FloatImage, FloatArray]:
        """
        Return the template at the scale of ``affine``, (2, 2), of the feature at ``point``, (2,).

        Shape (S, S), S = 2 radius + 1; and the map of its pixels to current offsets, (2, 2).
        """
        level = int(_levels(affine[None])[0])
        patch = self._template(feature, point, level).patch.reshape(2 * self.radius + 1, -1)
        return patch, affine / float(_scale(np.array([level]))[0])

    def region(
        self, image: FloatImage, centre: FloatArray, local: FloatArray, reach: int
    ) -> FloatImage:
        """
        Return ``image`` around ``centre``, (2,) [px], resampled up to ``reach`` template pixels.

        Shape (2 reach + 1, 2 reach + 1); ``local``, (2, 2), maps template pixels to offsets.
        """
        side = np.arange(-reach, reach + 1, dtype=np.float64)
        points = centre + np.stack(np.meshgrid(side, side), axis=-1) @ local.T
        return bilinear(image, points[..., 0], points[..., 1])

    def align(self, warps: Warps, image: FloatImage, *, iterations: int) -> Alignment:
        """
        Align every feature of ``warps`` with its patch in the desired image.

        ``image`` is the current one, float32 of shape (H, W). A patch without texture keeps its
        position and gets correlation 0, as does one that moves more than MAX_CORRECTION.
        """
        if not len(warps):
            return Alignment(warps, np.empty(0), np.empty(0))
        levels = _levels(warps.affine)
        patches, updates = self._stacked(warps, levels)
        scale = _scale(levels)[:, None, None]
        local, centre = warps.affine / scale, warps.current.copy()
        for _ in range(iterations):
            unit, _ = _normalised(self._sample(image, centre, local))
            step = (updates @ (unit - patches)[:, :, None])[:, :, 0].astype(np.float64)
            local, centre = _composed(local, centre, step)
        unit, deviation = _normalised(self._sample(image, centre, local))
        correlation = np.einsum('np,np->n', unit, patches).astype(np.float64)
        correction = np.linalg.norm(centre - warps.current, axis=1)
        # A comparison with nan is false: what diverged stays where it was.
        stays = ~(correction <= MAX_CORRECTION) | ~np.isfinite(local).all(axis=(1, 2))
        correlation = np.where(stays, 0.0, correlation)
        residual = deviation * np.sqrt(np.maximum(2.0 - 2.0 * correlation, 0.0))
        centre[stays], affine = warps.current[stays], local * scale
        affine[stays] = warps.affine[stays]
        return Alignment(replace(warps, current=centre, affine=affine), correlation, residual)

    def _sample(self, image: FloatImage, centre: FloatArray, local: FloatArray) -> FloatImage:
        """Return the current patches, shape (N, P), by bilinear interpolation."""
        rows = np.concatenate([local, centre[:, :, None]], axis=2)  # (N, 2, 3): x' and y'
        points = rows.astype(np.float32) @ self._grid_rows
        return bilinear(image, points[:, 0], points[:, 1])

    def _stacked(self, warps: Warps, levels: IntArray) -> tuple[FloatImage, FloatImage]:
        """Return the unit patches, shape (N, P), and update matrices, (N, 6, P), of features."""
        templates = [
            self._template(int(feature), point, int(level))
            for feature, point, level in zip(warps.ids, warps.desired, levels, strict=True)
        ]
        return np.stack([it.patch for it in templates]), np.stack([it.update for it in templates])

    def _template(self, feature: int, point: FloatArray, level: int) -> _Template:
        if (feature, level) not in self._templates:
            self._templates[feature, level] = self._make_template(point, level)
        return self._templates[feature, level]

    def _make_template(self, point: FloatArray, level: int) -> _Template:
        image, stride = self._images[level], 1.0 / float(_scale(np.array([level]))[0])
        points = point + self._grid * stride
        patch, deviation = _normalised(bilinear(image, points[None, :, 0], points[None, :, 1]))
        if not deviation[0] > 0.0:
            return _Template(np.zeros_like(patch[0]), np.zeros((6, patch.size), np.float32))
        slope = _slopes(image, points, stride)
        norm = float(deviation[0]) * np.sqrt(len(self._grid))
        return _Template(patch[0], _update_matrix(slope, self._grid, patch[0], norm))


def float_image(image: Image) -> FloatImage:
    """Return ``image`` as float32, which OpenCV interpolates without rounding."""
    return np.asarray(image.astype(np.float32))


def bilinear(image: FloatImage, x: NDArray[Any], y: NDArray[Any]) -> FloatImage:
    """
    Sample ``image``, float32 of shape (H, W), at ``x`` and ``y`` [px], shape (M, P) each.

    Points outside take the value of the border. OpenCV 5 interpolates float images exactly; of
    8-bit ones it rounds the result, which costs a hundredth of a pixel.
    """
    x, y = x.astype(np.float32, copy=False), y.astype(np.float32, copy=False)
    sampled = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(sampled, dtype=np.float32)


def _scale(levels: IntArray) -> FloatArray:
    return np.asarray(2.0 ** (-levels / LEVELS_PER_OCTAVE))


def _levels(affine: FloatArray) -> IntArray:
    """Return the template level of each affine map: the nearest scale, never above one."""
    scale = np.sqrt(np.maximum(np.abs(np.linalg.det(affine)), 1e-6))
    levels = np.rint(-LEVELS_PER_OCTAVE * np.log2(scale))
    return np.asarray(np.clip(levels, 0, LEVELS - 1), dtype=np.int64)


def _blurred(image: Image, level: int) -> FloatImage:
    """Return ``image`` as float32, blurred as a view at the scale of ``level``."""
    enlargement = 1.0 / float(_scale(np.array([level]))[0])
    deviation = PIXEL_BLUR * np.sqrt(enlargement**2 - 1.0)
    if deviation == 0.0:
        return float_image(image)
    return np.asarray(cv2.GaussianBlur(float_image(image), (0, 0), float(deviation)))


def _slopes(image: FloatImage, points: FloatArray, stride: float) -> FloatArray:
    """Return the derivative of the patch along x and y per grid step, shape (2, P)."""
    x, y = points[None, :, 0], points[None, :, 1]
    along_x = bilinear(image, x + stride, y) - bilinear(image, x - stride, y)
    along_y = bilinear(image, x, y + stride) - bilinear(image, x, y - stride)
    return np.asarray(0.5 * np.concatenate([along_x, along_y]), dtype=np.float64)


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


def _normalised(patches: FloatImage) -> tuple[FloatImage, FloatArray]:
    """Return patches of zero mean and unit norm, shape (N, P), and their deviations, (N,)."""
    centred = patches - patches.mean(axis=-1, keepdims=True)
    norm = np.sqrt(np.einsum('np,np->n', centred, centred))
    centred /= np.where(norm > 0.0, norm, 1.0)[:, None]
    return centred, norm.astype(np.float64) / np.sqrt(patches.shape[-1])


def _composed(
    local: FloatArray, centre: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the linear part and centre of W o dW^-1, dW the ``step``, shape (N, 6)."""
    matrix = np.eye(2) + step[:, 2:].reshape(len(step), 2, 2)
    with np.errstate(invalid='ignore', over='ignore'):  # a diverging step is not taken
        scale = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
        matrix[~(np.abs(scale) >= LEAST_SCALE)] = np.eye(2)
    composed = local @ np.linalg.inv(matrix)
    shift = np.einsum('nij,nj->ni', composed, step[:, :2])
    return composed, centre - shift
