"""Normal equations of the window: residuals at given unknowns, and features eliminated (Schur)."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.mapping.adjustment import projection
from visual_servo_epipolar.core.mapping.adjustment.factors import Factors
from visual_servo_epipolar.core.mapping.adjustment.projection import (
    BY_FEATURE,
    BY_SHARED,
    BY_VIEW,
    Projection,
    Structure,
)
from visual_servo_epipolar.core.mapping.adjustment.window import (
    KeyframeWindow,
    MOUNT,
    Unknowns,
    VIEW,
)

OUTLIER = 9.0  # square from which residuals count less, as one in a hundred true ones does
LEAST_INFORMATION = 1e-4  # of an inverse depth that nothing shows [m^2]
LEAST_OFFSET = 1e-4  # information of a ray of the photograph that is far off


def robust_weight(squares: FloatArray) -> FloatArray:
    """Return by how much residuals count: fully up to OUTLIER, then less and less."""
    share = OUTLIER / np.maximum(squares, OUTLIER)
    return np.asarray(share * share)


def robust_cost(squares: FloatArray) -> FloatArray:
    """Return what squares count: themselves up to OUTLIER, never more than twice that."""
    return np.where(
        squares <= OUTLIER, squares, 2.0 * OUTLIER - OUTLIER**2 / np.maximum(squares, OUTLIER)
    )


@dataclass(frozen=True, eq=False)
class Evaluation:
    """
    Residuals of a window at ``unknowns``; ``squares`` of views, (K, N), and their ``cost``.

    Squares count as outliers from ``widening`` times the usual bound, far from the best unknowns.
    """

    window: KeyframeWindow
    unknowns: Unknowns
    trusted: BoolArray
    factors: Factors
    widening: float = 1.0
    structure: Structure = field(init=False)
    projection: Projection = field(init=False)
    squares: FloatArray = field(init=False)
    cost: float = field(init=False)

    def __post_init__(self) -> None:
        window, unknowns = self.window, self.unknowns
        structure = projection.structure_of(window.photograph, window.tangents, unknowns)
        projected = projection.project(structure, unknowns.views, window.tangent_basis)
        squares = projection.squares_of(projected, window.rays)
        offsets = (unknowns.offsets**2).sum(0) / self.widening
        counted = robust_cost(squares / self.widening) * window.seen
        image = self.widening * float((counted.sum(0) + robust_cost(offsets)) @ self.trusted)
        cost = image + self.factors.cost(unknowns)
        values = {'structure': structure, 'projection': projected, 'squares': squares}
        for name, value in {**values, 'cost': cost}.items():
            object.__setattr__(self, name, value)

    @property
    def weight(self) -> FloatArray:
        """How much observations count, (K, N)."""
        return np.asarray(self.window.seen * robust_weight(self.squares / self.widening))

    @property
    def offset_weight(self) -> FloatArray:
        """How much the photograph's rays count, (N,)."""
        return robust_weight((self.unknowns.offsets**2).sum(0) / self.widening)


class System(NamedTuple):
    """
    Normal equations of D views' and shared unknowns, and what features follow by.

    ``roots``, (N, 3, 3), times their transposes are the inverted blocks of features, ``coupled``,
    (N, 3, D), the transposed roots times their coupling, ``gradient``, (N, 3), likewise.
    """

    matrix: FloatArray
    vector: FloatArray
    roots: FloatArray
    coupled: FloatArray
    gradient: FloatArray

    def features(self, step: FloatArray) -> FloatArray:
        """Return the step of features, (3, N), that follows from a ``step`` of the others."""
        rest = self.gradient + self.coupled @ step
        return np.asarray(-(self.roots @ rest[..., None])[..., 0].T)


def system_of(at: Evaluation) -> System:
    """Return the normal equations; features that are not trusted follow views, not lead them."""
    window, size = at.window, at.unknowns.views.size + len(at.unknowns.shared)
    root = np.sqrt(at.weight)
    found = projection.slopes(at.structure, at.unknowns.views, window.tangent_basis, at.projection)
    found *= root[:, None, None]
    found[:, BY_VIEW] *= at.trusted
    found[:, BY_SHARED] *= at.trusted
    residuals = root[:, None] * at.projection.residuals
    own = found[:, BY_FEATURE]
    products = (
        own[:, :, None, 0] * found[:, None, :, 0] + own[:, :, None, 1] * found[:, None, :, 1]
    )
    roots, coupled = _eliminated(at, products, size)
    pull = (own * residuals[:, None]).sum((0, 2))
    pull[:2] += at.offset_weight * at.unknowns.offsets
    gradient = (roots.swapaxes(1, 2) @ pull.T[..., None])[..., 0]
    matrix, vector = _whole(found, residuals, size)
    prior, slope = at.factors.equations(at.unknowns)
    rows = coupled.reshape(-1, size)
    return System(
        matrix + prior - rows.T @ rows,
        vector + slope - rows.T @ gradient.ravel(),
        roots,
        coupled,
        gradient,
    )


def _eliminated(at: Evaluation, products: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Return roots of inverted blocks of features, and their coupling times those."""
    views, _, _, count = products.shape
    blocks = products[:, :, BY_FEATURE].sum(0)
    blocks[[0, 1], [0, 1]] += at.offset_weight + LEAST_OFFSET
    blocks[2, 2] += LEAST_INFORMATION
    roots = inverse_roots(blocks)
    coupling = np.zeros((count, 3, size))
    by_view = coupling[..., : VIEW * views].reshape(count, 3, views, VIEW)
    by_view[...] = products[:, :, BY_VIEW].transpose(3, 1, 0, 2)
    coupling[..., : VIEW * views] = by_view.reshape(count, 3, -1)
    both = slice(VIEW * views, VIEW * views + MOUNT.start)
    coupling[..., both] = products[:, :, BY_SHARED].sum(0).transpose(2, 0, 1)
    return roots, np.asarray(roots.swapaxes(1, 2) @ coupling)


def _whole(found: FloatArray, residuals: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Return equations of views and of what all share before features are eliminated."""
    views = len(found)
    rows = found.reshape(views, projection.UNKNOWNS, -1)
    products = rows @ rows.swapaxes(1, 2)
    pulls = (rows @ residuals.reshape(views, -1, 1))[..., 0]
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    both = slice(VIEW * views, VIEW * views + MOUNT.start)
    for k in range(views):
        own = slice(VIEW * k, VIEW * (k + 1))
        matrix[own, own] = products[k, BY_VIEW, BY_VIEW]
        matrix[own, both] = products[k, BY_VIEW, BY_SHARED]
        matrix[both, own] = products[k, BY_SHARED, BY_VIEW]
    matrix[both, both] = products[:, BY_SHARED, BY_SHARED].sum(0)
    vector[: VIEW * views] = pulls[:, BY_VIEW].ravel()
    vector[both] = pulls[:, BY_SHARED].sum(0)
    return matrix, vector


def inverse_roots(blocks: FloatArray) -> FloatArray:
    """Return L^-T, (N, 3, 3), of L L^T = ``blocks``, (3, 3, N), by components for speed."""
    a = np.sqrt(blocks[0, 0])
    b, d = blocks[1, 0] / a, blocks[2, 0] / a
    c = np.sqrt(blocks[1, 1] - b * b)
    e = (blocks[2, 1] - b * d) / c
    f = np.sqrt(blocks[2, 2] - d * d - e * e)
    roots = np.zeros((len(a), 3, 3))
    roots[:, 0, 0], roots[:, 1, 1], roots[:, 2, 2] = 1.0 / a, 1.0 / c, 1.0 / f
    roots[:, 0, 1] = -b * roots[:, 0, 0] * roots[:, 1, 1]
    roots[:, 1, 2] = -e * roots[:, 1, 1] * roots[:, 2, 2]
    roots[:, 0, 2] = -(d * roots[:, 0, 0] + e * roots[:, 0, 1]) * roots[:, 2, 2]
    return roots
