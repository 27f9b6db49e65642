"""Refinement of the window: damped Gauss-Newton steps, and which features are wrong matches."""

from dataclasses import dataclass, replace
from functools import cached_property
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.geometry.least_squares import Damped, Equations, least_squares
from visual_servo_epipolar.core.mapping.adjustment.equations import (
    Evaluation,
    OUTLIER,
    System,
    system_of,
)
from visual_servo_epipolar.core.mapping.adjustment.factors import factors_of
from visual_servo_epipolar.core.mapping.adjustment.projection import project, squares_of
from visual_servo_epipolar.core.mapping.adjustment.window import KeyframeWindow, SHARED, Unknowns
from visual_servo_epipolar.core.mapping.feature_observations import MapSettings

DAMPING = 1e-4
LEAST_GAIN = 0.05  # of the cost, below which nothing changes that matters
LEAST_INVERSE_DEPTH = 1e-6  # [1/m]
NEGLIGIBLE = 1e-2  # square of what an error of keyframes does to all features, in deviations
WRONG_SHARE = 0.4  # of the observations that are outliers, from which the whole feature is one
WRONG_OFFSET = 16.0  # square of what the photograph's ray is off by, in deviations
# Times nearer than the median feature, by so few views: wrong matches near the photograph are.
NEAREST, FEW_VIEWS = 50.0, 2
RETURN = 0.6  # of both bounds: what was wrong must be well below to count again


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
    def _coupled(self) -> FloatArray:
        """The coupling of features with errors of views in units of their own, (N, 3, D)."""
        return _times(self.system.coupled, self.root)

    @cached_property
    def feature_roots(self) -> FloatArray:
        """What the errors of views make of features, (N, 3, D): covariance by the transpose."""
        return np.asarray(-(self.system.roots @ self._coupled))

    @cached_property
    def covariance_root(self) -> FloatArray:
        """
        Root of the covariance, (D, r), but for directions in which it shows nowhere.

        In those an error of the keyframes displaces no feature by enough to be seen. The
        root is taken along axes of what it does to all features, in deviations of their own; of
        75 directions 30 are left, and a view is resected on as many unknowns less.
        """
        window, root = self.window, self.root
        features = self._coupled[self.trusted].reshape(-1, len(root))
        count, noise = max(2 * int(self.trusted.sum()), 1), float(window.photograph_noise.min())
        photograph = root[-SHARED:-2] * (math.sqrt(count) / noise)
        mount = root[-2:] / self.evaluation.factors.jitter
        rows = np.concatenate([features, photograph, mount])
        squares, axes = np.linalg.eigh(rows.T @ rows)
        return np.asarray(root @ axes[:, squares > NEGLIGIBLE])

    @cached_property
    def feature_covariance_root(self) -> FloatArray:
        """What the errors of ``covariance_root`` make of features, (N, 3, r)."""
        return np.asarray(-(self.system.roots @ _times(self.system.coupled, self.covariance_root)))

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
        asked = self.feature_covariance, self.feature_covariance_root, self.wrong, self.depth
        assert all(value is not None for value in asked)


def _times(coupled: FloatArray, root: FloatArray) -> FloatArray:
    """Return the coupling of features, (N, 3, D), times a root, (D, r), in one product."""
    size, count = root.shape
    return np.asarray((coupled.reshape(-1, size) @ root).reshape(-1, 3, count))


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
        at = replace(start, unknowns=start.factors.at_scale(start.unknowns))
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
    trusted = (outlying <= slack * WRONG_SHARE) & (offset <= slack * WRONG_OFFSET)
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
    projection = project(ahead, at.unknowns.views, at.window.tangent_basis)
    return squares_of(projection, at.window.rays)
