"""
Refinement of the window: damped Gauss-Newton steps, and which features are wrong matches.

Residuals and normal equations at given unknowns, of which features are eliminated (Schur).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.geometry.least_squares import (
    CONTRADICTING,
    Damped,
    Equations,
    least_squares,
)
from visual_servo_epipolar.core.mapping import projection
from visual_servo_epipolar.core.mapping.factors import Factors, factors_of
from visual_servo_epipolar.core.mapping.projection import (
    BY_FEATURE,
    BY_SHARED,
    BY_VIEW,
    project,
    Projection,
    squares_of,
    Structure,
)
from visual_servo_epipolar.core.mapping.window import (
    KeyframeWindow,
    MapSettings,
    MOUNT,
    Unknowns,
    VIEW,
)

DAMPING = 1e-4
LEAST_GAIN = 0.05  # of the cost, below which nothing changes that matters
LEAST_INVERSE_DEPTH = 1e-6  # [1/m]
WRONG_SHARE = 0.4  # of the observations that are outliers, from which the whole feature is one
# Times nearer than the median feature, by so few views: wrong matches near the photograph are.
NEAREST, FEW_VIEWS = 50.0, 2
RETURN = 0.6  # of both bounds: what was wrong must be well below to count again
OUTLIER = 9.0  # square from which residuals count less, as one in a hundred true ones does
LEAST_INFORMATION = 1e-4  # of an inverse depth that nothing shows [m^2], of a ray that is far off


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
    blocks[[0, 1], [0, 1]] += at.offset_weight + LEAST_INFORMATION
    blocks[2, 2] += LEAST_INFORMATION
    roots = inverse_roots(blocks)
    coupling = np.zeros((count, 3, size))
    by_view = products[:, :, BY_VIEW].transpose(3, 1, 0, 2)
    coupling[..., : VIEW * views] = by_view.reshape(count, 3, -1)
    both = slice(VIEW * views, VIEW * views + MOUNT.start)
    coupling[..., both] = products[:, :, BY_SHARED].sum(0).transpose(2, 0, 1)
    return roots, np.asarray(roots.swapaxes(1, 2) @ coupling)


def _whole(found: FloatArray, residuals: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Return equations of views and of what all share before features are eliminated."""
    views = len(found)
    rows = found.reshape(views, BY_SHARED.stop, -1)
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


@dataclass(frozen=True, eq=False)
class Geometry:
    """Refined window: the ``evaluation`` at the best unknowns, and whether steps still gain."""

    evaluation: Evaluation
    converged: bool = False
    damping: float = DAMPING

    @property
    def unknowns(self) -> Unknowns:
        """The best values."""
        return self.evaluation.unknowns

    @property
    def window(self) -> KeyframeWindow:
        """The keyframes."""
        return self.evaluation.window

    @property
    def trusted(self) -> BoolArray:
        """Which features are no wrong matches, shape (N,)."""
        return self.evaluation.trusted

    @cached_property
    def wrong(self) -> IntArray:
        """The ids of wrong matches."""
        return np.asarray(self.window.ids[~self.trusted])

    @cached_property
    def system(self) -> System:
        """Normal equations at the best unknowns."""
        return system_of(self.evaluation)

    @cached_property
    def root(self) -> FloatArray:
        """Root of the covariance of views and shared unknowns: times its transpose, (D, D)."""
        matrix = self.system.matrix
        scale = 1.0 / np.sqrt(np.diag(matrix))
        lower = np.linalg.cholesky(matrix * scale * scale[:, None])
        return np.asarray(scale[:, None] * np.linalg.inv(lower).T)

    @cached_property
    def feature_roots(self) -> FloatArray:
        """What the errors of views make of features, (N, 3, D): covariance by the transpose."""
        coupled = self.system.coupled.reshape(-1, len(self.root)) @ self.root  # in one product
        return np.asarray(-(self.system.roots @ coupled.reshape(self.system.coupled.shape)))

    @cached_property
    def feature_covariance(self) -> FloatArray:
        """Covariance of two offsets and the inverse depth of each feature, (3, 3, N)."""
        roots = np.concatenate([self.system.roots, self.feature_roots], axis=-1)
        return np.asarray((roots @ roots.swapaxes(1, 2)).transpose(1, 2, 0))

    @cached_property
    def depth(self) -> float:
        """Median depth of trusted features [m]."""
        near = self.unknowns.inverse_depth[self.trusted]
        return 1.0 / max(median(near), LEAST_INVERSE_DEPTH) if len(near) else 1.0

    @cached_property
    def noise_ratio(self) -> float:
        """Deviation of residuals over what was expected of the noise."""
        weight = self.evaluation.weight * self.trusted
        squares = float((weight * self.evaluation.squares).sum())
        squares += float((self.unknowns.offsets**2).sum(0) @ self.trusted)
        freedom = 2.0 * weight.sum() - self.trusted.sum() - 5 * len(self.window)
        return math.sqrt(squares / freedom) if freedom > 0.0 else math.inf

    def prepare(self) -> None:
        """Compute what the next view will ask for, while no caller waits."""
        asked = self.feature_covariance, self.wrong, self.depth
        assert all(value is not None for value in asked)


def refine(
    start: Evaluation, steps: int, damping: float = DAMPING, system: System | None = None
) -> Geometry:
    """Return the geometry after at most ``steps`` (Levenberg, Marquardt) from the ``system``."""

    def linearise(now: Geometry, number: int) -> Damped:
        nonlocal system
        system = system_of(now.evaluation) if system is None else system
        return Damped(Equations(system.matrix, system.vector), now.damping)

    def moved(now: Geometry, found: Damped, change: FloatArray) -> tuple[Geometry, bool]:
        nonlocal system
        assert system is not None
        unknowns = now.unknowns.moved(-change, system.features(-change))
        candidate = replace(now.evaluation, unknowns=unknowns)
        gain = now.evaluation.cost - candidate.cost
        if not gain > 0.0:
            converged, damping = gain > -LEAST_GAIN, min(100.0 * now.damping, 1e3)
            return Geometry(now.evaluation, converged, damping), converged
        system, converged = None, gain < LEAST_GAIN
        return Geometry(candidate, converged, max(0.1 * now.damping, 1e-9)), converged

    at = start
    if system is None:  # damped steps hardly move along what so little is known of
        ratio = start.factors.ratio(start.unknowns)
        at = replace(start, unknowns=start.unknowns.scaled(ratio))
    geometry = Geometry(at, damping=damping)
    if steps:
        geometry, _ = least_squares(geometry, linearise, moved, steps)
    return replace(geometry, evaluation=judge_matches(geometry.evaluation))


def rescale(
    geometry: Geometry, window: KeyframeWindow, settings: MapSettings
) -> tuple[Geometry, float]:
    """Return the geometry by the ways of another ``window``, and how many times as large it is."""
    before = geometry.evaluation
    factors = factors_of(before.factors.mount, window, settings)
    start = replace(before, window=window, factors=factors)
    return refine(start, 0, geometry.damping), factors.ratio(before.unknowns)


def judge_matches(at: Evaluation) -> Evaluation:
    """Return the evaluation with wrong matches found anew: those that views contradict."""
    seen = at.window.seen
    outlying = (seen & (_squares_ahead(at) > OUTLIER)).sum(0) / np.maximum(seen.sum(0), 1)
    offset = (at.unknowns.offsets**2).sum(0)
    slack = np.where(at.trusted, 1.0, RETURN)
    trusted = (outlying <= slack * WRONG_SHARE) & (offset <= slack * CONTRADICTING)
    near = at.unknowns.inverse_depth
    usual = median(near[at.trusted]) if at.trusted.any() else 0.0
    if usual > 0.0:  # what few views show may be anywhere
        trusted &= (near <= slack * NEAREST * usual) | (seen.sum(0) > FEW_VIEWS)
    if (trusted == at.trusted).all():
        return at
    return replace(at, trusted=trusted)


def _squares_ahead(at: Evaluation) -> FloatArray:
    """Return squares, (K, N), with no feature behind the cameras: at infinity at the farthest."""
    if not (at.unknowns.inverse_depth < 0.0).any():
        return at.squares
    ahead = at.structure._replace(inverse_depth=np.maximum(at.structure.inverse_depth, 0.0))
    projected = project(ahead, at.unknowns.views, at.window.tangent_basis)
    return squares_of(projected, at.window.rays)
