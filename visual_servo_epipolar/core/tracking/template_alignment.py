"""
Alignment of feature patches with the desired image, so that tracking does not drift.

Inverse-compositional affine alignment (Baker and Matthews 2004) of all features at once, blind to
gain and bias of the light. The template is the desired image blurred and sampled at the scale at
which the feature is seen now, so that both patches show the same detail.
"""

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, IntArray

RADIUS = 10  # patches have 2 RADIUS + 1 pixels a side, at the scale of the current image
LEVELS_PER_OCTAVE = 2
LEVELS = 8  # down to 1 / 11 of the size in the desired image
PIXEL_BLUR = 0.5  # standard deviation of what one pixel integrates over [px]
DAMPING = 1e-3
FloatImage: TypeAlias = NDArray[np.float32]  # an image made fit for interpolation, shape (H, W)
MAX_CORRECTION = 4.0  # of one alignment from where LK or the match put the feature [px]


@dataclass(frozen=True, slots=True, eq=False)
class Warps:
    """
    Where features are and how they are warped, rows are features.

    A desired offset xi from feature ``desired`` is seen at ``current`` + ``affine`` xi. ``ids``,
    shape (N,); points, shape (N, 2); ``affine``, shape (N, 2, 2).
    """

    ids: IntArray
    desired: FloatArray
    current: FloatArray
    affine: FloatArray

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: IntArray | BoolArray) -> 'Warps':
        """Return the rows chosen by index or mask."""
        return Warps(self.ids[rows], self.desired[rows], self.current[rows], self.affine[rows])

    def joined(self, other: 'Warps') -> 'Warps':
        """Return the rows of both."""
        return Warps(
            np.concatenate([self.ids, other.ids]),
            np.concatenate([self.desired, other.desired]),
            np.concatenate([self.current, other.current]),
            np.concatenate([self.affine, other.affine]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Aligned warps; zero-mean normalised correlation and residual [grey levels], shape (N,)."""

    warps: Warps
    correlation: FloatArray
    residual: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """One feature at one scale: normalised patch, (P,), and update matrix, (6, P)."""

    patch: FloatImage
    update: FloatImage


class Anchor:
    """The desired image, ready to align features with; templates are made as scales come up."""

    def __init__(self, image: Image) -> None:
        self._images = [_blurred(image, level) for level in range(LEVELS)]
        self._templates: dict[tuple[int, int], _Template] = {}
        side = np.arange(-RADIUS, RADIUS + 1, dtype=np.float64)
        self._grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)  # rows: (x, y)
        self._grid_rows = np.column_stack([self._grid, np.ones(len(self._grid))]).T.astype(
            np.float32
        )

    def patch(
        self, key: int, point: FloatArray, affine: FloatArray
    ) -> tuple[FloatImage, FloatArray]:
        """Return the desired patch as seen under ``affine``, (S, S), and its map of pixels."""
        level = int(_levels(affine[None])[0])
        side = 2 * RADIUS + 1
        patch = self._template(key, point, level).patch.reshape(side, side)
        return patch, affine / float(_scale(np.array([level]))[0])

    def region(
        self, image: FloatImage, centre: FloatArray, local: FloatArray, reach: int
    ) -> FloatImage:
        """Return what is around ``centre`` in the frame of the patch, up to ``reach`` [px]."""
        side = np.arange(-reach, reach + 1, dtype=np.float64)
        grid = np.stack(np.meshgrid(side, side), axis=-1)
        points = centre + grid @ local.T
        return bilinear(image, points[..., 0], points[..., 1])

    def align(self, warps: Warps, image: FloatImage, *, iterations: int) -> Alignment:
        """
        Align every feature of ``warps`` with its patch in the desired image.

        ``image`` is the current one, made float32 by ``float_image``. A patch without texture
        keeps its place and gets correlation 0.
        """
        if not len(warps):
            return Alignment(warps, np.empty(0), np.empty(0))
        levels = _levels(warps.affine)
        templates = [
            self._template(int(key), point, int(level))
            for key, point, level in zip(warps.ids, warps.desired, levels, strict=True)
        ]
        patches = np.stack([template.patch for template in templates])
        updates = np.stack([template.update for template in templates])
        scale = _scale(levels)[:, None, None]
        local, centre = warps.affine / scale, warps.current.copy()
        for _ in range(iterations):
            unit, _ = _normalised(self._sample(image, centre, local))
            step = (updates @ (unit - patches)[:, :, None])[:, :, 0].astype(np.float64)
            local, centre = _composed(local, centre, step)
        unit, deviation = _normalised(self._sample(image, centre, local))
        correlation = np.einsum('np,np->n', unit, patches).astype(np.float64)
        moved = np.linalg.norm(centre - warps.current, axis=1)
        correlation = np.where(moved <= MAX_CORRECTION, correlation, 0.0)
        residual = deviation * np.sqrt(np.maximum(2.0 - 2.0 * correlation, 0.0))
        aligned = replace(warps, current=centre, affine=local * scale)
        return Alignment(aligned, correlation, residual)

    def _sample(self, image: FloatImage, centre: FloatArray, local: FloatArray) -> FloatImage:
        """Return the current patches, shape (N, P), by bilinear interpolation."""
        rows = np.concatenate([local, centre[:, :, None]], axis=2)  # (N, 2, 3): x' and y'
        points = rows.astype(np.float32) @ self._grid_rows
        return bilinear(image, points[:, 0], points[:, 1])

    def _template(self, key: int, point: FloatArray, level: int) -> _Template:
        if (key, level) not in self._templates:
            self._templates[key, level] = self._make_template(point, level)
        return self._templates[key, level]

    def _make_template(self, point: FloatArray, level: int) -> _Template:
        image, stride = self._images[level], 1.0 / float(_scale(np.array([level]))[0])
        around = point + self._grid * stride
        patch, deviation = _normalised(bilinear(image, around[None, :, 0], around[None, :, 1]))
        if not deviation[0] > 0.0:
            size = len(self._grid)
            return _Template(np.zeros(size, np.float32), np.zeros((6, size), np.float32))
        slope = _slopes(image, around, stride)
        x, y = self._grid.T
        descent = np.stack(
            [slope[0], slope[1], slope[0] * x, slope[0] * y, slope[1] * x, slope[1] * y]
        )
        # Gain and bias of the light must not look like motion: project both out.
        descent -= descent.mean(axis=1, keepdims=True)
        descent -= np.outer(descent @ patch[0], patch[0])
        scale = np.array([1.0, 1.0, *[1.0 / RADIUS] * 4])  # one unit each moves pixels by one
        descent = descent * scale[:, None]
        hessian = descent @ descent.T
        hessian += DAMPING * np.trace(hessian) / 6.0 * np.eye(6)
        norm = float(deviation[0]) * np.sqrt(len(self._grid))
        update = scale[:, None] * (np.linalg.solve(hessian, descent) * norm)
        return _Template(patch[0], update.astype(np.float32))


def float_image(image: Image) -> FloatImage:
    """Return ``image`` as float32, which OpenCV interpolates without rounding."""
    converted: FloatImage = image.astype(np.float32)
    return converted


def bilinear(image: FloatImage, x: NDArray[Any], y: NDArray[Any]) -> FloatImage:
    """
    Sample ``image``, float32 of shape (H, W), at ``x`` and ``y``, shape (M, P) each.

    Points outside take the value of the border. Of float images OpenCV 5 interpolates exactly; of
    8-bit ones it rounds the result, which costs a hundredth of a pixel.
    """
    sampled = cv2.remap(
        image,
        x.astype(np.float32, copy=False),
        y.astype(np.float32, copy=False),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(sampled, dtype=np.float32)


def _scale(levels: IntArray) -> FloatArray:
    return np.asarray(2.0 ** (-levels / LEVELS_PER_OCTAVE))


def _levels(affine: FloatArray) -> IntArray:
    """Return the template level of each affine map: the nearest scale, never above one."""
    scale = np.sqrt(np.maximum(np.abs(np.linalg.det(affine)), 1e-6))
    levels = np.rint(-LEVELS_PER_OCTAVE * np.log2(scale))
    return np.asarray(np.clip(levels, 0, LEVELS - 1), dtype=np.int64)


def _blurred(image: Image, level: int) -> FloatImage:
    """Return ``image`` as float32 with the blur of a view that shows it smaller."""
    enlargement = 1.0 / float(_scale(np.array([level]))[0])
    deviation = PIXEL_BLUR * np.sqrt(enlargement**2 - 1.0)
    if deviation == 0.0:
        return float_image(image)
    return np.asarray(cv2.GaussianBlur(float_image(image), (0, 0), float(deviation)))


def _slopes(image: FloatImage, around: FloatArray, stride: float) -> FloatArray:
    """Return the derivative of the patch along x and y per grid step, shape (2, P)."""
    x, y = around[None, :, 0], around[None, :, 1]
    along_x = bilinear(image, x + stride, y) - bilinear(image, x - stride, y)
    along_y = bilinear(image, x, y + stride) - bilinear(image, x, y - stride)
    return np.asarray(0.5 * np.concatenate([along_x, along_y]), dtype=np.float64)


def _normalised(patches: FloatImage) -> tuple[FloatImage, FloatArray]:
    """Return patches of zero mean and unit norm, shape (N, P), and their deviations, (N,)."""
    centred = patches - patches.mean(axis=-1, keepdims=True)
    norm = np.sqrt(np.einsum('np,np->n', centred, centred))
    centred /= np.where(norm > 0.0, norm, 1.0)[:, None]
    return centred, norm.astype(np.float64) / np.sqrt(patches.shape[-1])


def _composed(
    local: FloatArray, centre: FloatArray, step: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the warp followed by the inverse of the step: W <- W o dW^-1."""
    shape = (len(step), 2, 2)
    matrix = np.eye(2) + step[:, 2:].reshape(shape)
    new_local = local @ np.linalg.inv(matrix)
    shift = np.einsum('nij,nj->ni', new_local, step[:, :2])
    return new_local, centre - shift
