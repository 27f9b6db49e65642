"""The search for the dock: views of the photograph along the path become its pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.planar_poses import (
    camera_at,
    compose,
    inverse_pose,
    relative_pose,
)
from visual_servo_epipolar.core.mapping.adjustment.equations import Evaluation, OUTLIER
from visual_servo_epipolar.core.mapping.adjustment.factors import (
    camera_poses,
    DIFFERENCE,
    ON_BASE,
    PathFactors,
    views_of,
)
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry, refine
from visual_servo_epipolar.core.mapping.adjustment.window import (
    EMPTY,
    HEADING,
    KeyframeWindow,
    PHOTOGRAPH,
    Unknowns,
    VIEW,
)
from visual_servo_epipolar.core.mapping.feature_observations import FeatureObservations
from visual_servo_epipolar.core.mapping.initialization import (
    refine_narrowing,
    shared_at,
    triangulate,
)
from visual_servo_epipolar.core.odometry.path import PathPlace, uncertainty
from visual_servo_epipolar.core.perception.memory import PerceptionMemory
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive

FIRST_DISTANCES = np.geomspace(0.1, 20.0, 28)  # to begin with, the best of them [m]
FIRST_ITERATIONS, ITERATIONS = 20, 6
WIDENING = 3.0  # of the bound for outliers, by which guesses are compared
CONTRADICTION = 2.0  # deviations, root mean square, of images or of the path: no noise is so
LEAST_INLIERS = 0.5  # of the features in the last view, that others explain
MAX_CONTRADICTIONS = 8  # in a row: then all is begun anew
# Deviation over the distance, and deviation [m], above which the best guess is looked for anew.
UNCERTAIN, UNCERTAIN_M = 0.25, 0.03
MOST_FEATURES = 80  # those seen most often: more cost time, and tell little
SAME_RAY = 1e-6  # [rad]


@dataclass(frozen=True, slots=True, eq=False)
class DockPose:
    """
    Pose of the dock in axes of the base at ``stamp_ns``: x forward, y left [m], turn [rad].

    The dock is the base as it stood at the photograph. ``covariance``, (3, 3), is of all three.
    """

    stamp_ns: int
    pose: FloatArray
    covariance: FloatArray

    @property
    def deviation(self) -> float:
        """Deviation of the place along its worst direction [m]."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]), 0.0))

    def turned(self, angle: float) -> FloatArray:
        """Return the covariance in axes in which those of the base are turned by ``angle``."""
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        return np.asarray(turn @ self.covariance @ turn.T)

    @property
    def heading_deviation(self) -> float:
        """Deviation of the heading [rad]."""
        return math.sqrt(max(float(self.covariance[2, 2]), 0.0))


def dock_of(geometry: Geometry, noise_ratio: float, stamp_ns: int) -> DockPose:
    """Return the dock's pose at the last view, its covariance grown by the ``noise_ratio``."""
    unknowns, size = geometry.unknowns, geometry.unknowns.views.size
    view = range(size - VIEW, size - VIEW + HEADING + 1)
    rows = [*view, *range(size + ON_BASE.start, size + ON_BASE.stop)]
    values = np.concatenate([unknowns.views[-1, : HEADING + 1], unknowns.shared[ON_BASE]])
    slopes = np.stack(
        [
            (_dock(values + step) - _dock(values - step)) / (2.0 * DIFFERENCE)
            for step in DIFFERENCE * np.eye(6)
        ],
        axis=1,
    )
    root = max(noise_ratio, 1.0) * slopes @ geometry.root[rows]
    return DockPose(stamp_ns, _dock(values), root @ root.T)


def _dock(values: FloatArray) -> FloatArray:
    """Return the dock in the base from view, (3,), and mount, (3,): M C^-1 M^-1."""
    (camera,), mount = camera_poses(values[None, :3]), values[3:]
    pose = compose(compose(mount, inverse_pose(camera)), inverse_pose(mount))
    pose[2] = math.remainder(pose[2], 2.0 * math.pi)
    return pose


@dataclass(frozen=True, slots=True, eq=False)
class KeyView:
    """View along the path: where the base was, what it saw, and the bearings of that pair."""

    place: PathPlace
    observation: Observation
    bearings: Bearings | None
    parallax: float

    @property
    def ids(self) -> IntArray:
        """The features by name, (N,)."""
        ids = self.observation.ids
        return np.arange(len(self.observation)) if ids is None else ids

    def is_of_another_photograph(self, other: 'KeyView') -> bool:
        """Return whether features of one name have other rays in the photograph."""
        _, mine, its = np.intersect1d(self.ids, other.ids, return_indices=True)
        if not len(mine):
            return bool(len(self.ids) and len(other.ids))
        apart = np.abs(self.observation.desired[mine] - other.observation.desired[its])
        return bool(np.median(apart.max(axis=1)) > SAME_RAY)


@dataclass(frozen=True, eq=False)
class Solution:
    """
    The best ``geometry`` of views and path.

    ``noise_ratio`` is the deviation of the residuals of images and of the path, the larger one,
    over that expected; ``inliers`` the share of the observations in the last view that agree.
    """

    geometry: Geometry
    noise_ratio: float
    inliers: float

    @property
    def unknowns(self) -> Unknowns:
        """The best values."""
        return self.geometry.unknowns

    @property
    def cost(self) -> float:
        """The sum of squares, in deviations."""
        return self.geometry.evaluation.cost


@dataclass(frozen=True, eq=False)
class DockSearch:
    """
    What is known on the way; a new search begins from ``DockSearch()``.

    ``keys`` are the views kept, ``solution`` that of them and the last view, ``estimate`` the
    pose that follows from it. ``dock`` is that, or None, for the ``reason``, where nothing may be
    published.
    """

    keys: tuple[KeyView, ...] = ()
    last: KeyView | None = None
    solution: Solution | None = None
    memory: PerceptionMemory | None = None
    frame: int = 0
    contradictions: int = 0
    dock: DockPose | None = None
    estimate: DockPose | None = None
    reason: str = 'nothing was seen yet'


def update_search(
    search: DockSearch, observation: Observation, place: PathPlace, settings: DockPoseSettings
) -> DockSearch:
    """Return the search after an ``observation`` from a ``place``, or a ``reason``."""
    perception = perceive(observation, settings, search.frame, search.memory)
    search = replace(search, memory=perception.memory, frame=search.frame + 1, dock=None)
    measurement = perception.measurement
    if len(observation) < settings.min_features:
        return replace(search, reason=measurement.reason)
    seen = observation.corrected(perception.memory.lens)
    now = KeyView(place, seen, measurement.bearings, measurement.parallax)
    last = search.last
    if last and (last.place.epoch != place.epoch or now.is_of_another_photograph(last)):
        search = DockSearch(memory=perception.memory, frame=search.frame)
    return _publish(_solve(search, now, perception.memory, settings), now, settings)


def _solve(
    search: DockSearch, now: KeyView, memory: PerceptionMemory, settings: DockPoseSettings
) -> DockSearch:
    """Return the search with the solution of the views kept and of this one."""
    keys, views = search.keys, (*search.keys, now)
    new = not keys or moved_enough(keys[-1], now, settings)
    if new:
        keys = thin_out(views, settings.key_views)
    elif len(keys) == 1:  # it has not moved, and one view tells no distance
        views = keys
    solution = None
    if len(views) > 1:
        solution = _best(views, search, memory, settings, doubt=new)
    return replace(search, keys=keys, last=now, solution=solution, estimate=None)


def _best(
    views: tuple[KeyView, ...],
    search: DockSearch,
    memory: PerceptionMemory,
    settings: DockPoseSettings,
    *,
    doubt: bool,
) -> Solution | None:
    """Return the solution carried on along the path, or by the best guess where in ``doubt``."""
    window, factors = window_of(views, memory.noise), factors_along(views, settings)
    known = None
    if search.solution is not None and search.last is not None:
        last = search.solution.unknowns
        at = compose(camera_poses(last.views[-1:])[0], inverse_pose(last.shared[ON_BASE]))
        start = _guess(window, factors, views, search.last.place, at, last.shared)
        known = _refine(start, ITERATIONS)
        if not contradiction(known) and not (doubt and _is_uncertain(known)):
            return known
    first = _first_guess(window, factors, views, memory)
    if first is None:
        return known
    other = _refine(first, FIRST_ITERATIONS)
    return other if known is None or other.cost < known.cost else known


def _refine(start: Evaluation, iterations: int) -> Solution:
    at, damping = refine_narrowing(start)
    geometry = refine(at, iterations, damping)
    evaluation = geometry.evaluation
    factors, seen = evaluation.factors, evaluation.window.seen[-1]
    assert isinstance(factors, PathFactors)
    agree = seen & geometry.trusted & (evaluation.squares[-1] <= OUTLIER)
    return Solution(
        geometry,
        max(geometry.noise_ratio, factors.path_ratio(geometry.unknowns)),
        float(agree.sum()) / max(int(seen.sum()), 1),
    )


def _is_uncertain(solution: Solution) -> bool:
    """Return whether the distance is hardly known: another one may explain the views better."""
    dock = dock_of(solution.geometry, solution.noise_ratio, 0)
    distance = math.hypot(*dock.pose[:2].tolist())
    return dock.deviation > max(UNCERTAIN * distance, UNCERTAIN_M)


def _first_guess(
    window: KeyframeWindow,
    factors: PathFactors,
    views: tuple[KeyView, ...],
    memory: PerceptionMemory,
) -> Evaluation | None:
    """Return the best of several distances along the bearings with the largest parallax."""
    seen = [(view.parallax, view.bearings, view) for view in views if view.bearings is not None]
    if not seen:
        return None
    _, bearings, best = max(seen, key=lambda each: each[0])
    attitude = np.array([memory.attitude.tilt, memory.attitude.roll])
    shared = np.concatenate([shared_at(attitude), factors.prior])
    mount = inverse_pose(shared[ON_BASE])
    bases = [compose(camera_at(bearings, far), mount) for far in FIRST_DISTANCES]
    guesses = [_guess(window, factors, views, best.place, base, shared) for base in bases]
    return min(guesses, key=lambda guess: guess.cost)


def _guess(
    window: KeyframeWindow,
    factors: PathFactors,
    views: tuple[KeyView, ...],
    place: PathPlace,
    base: FloatArray,
    shared: FloatArray,
) -> Evaluation:
    """Return the geometry where the base was at pose ``base`` of the photograph's camera."""
    poses = np.array([relative_pose(place.pose, view.place.pose) for view in views])
    cameras = compose(compose(base[None], poses), np.broadcast_to(shared[ON_BASE], poses.shape))
    count = len(window.ids)
    rows = views_of(cameras, shared[PHOTOGRAPH])
    unknowns = Unknowns(rows, shared, np.zeros((2, count)), np.ones(count))
    near = triangulate(window, unknowns, np.ones(len(views), bool))
    everything = np.ones(count, bool)
    return Evaluation(window, replace(unknowns, inverse_depth=near), everything, factors, WIDENING)


def _publish(search: DockSearch, now: KeyView, settings: DockPoseSettings) -> DockSearch:
    """Return the search with the pose, where it may be published, or the reason why not."""
    solution = search.solution
    if solution is None:
        return replace(search, reason='the robot has not moved yet, or sees no bearings')
    reason = contradiction(solution)
    if reason:
        count = search.contradictions + 1
        if count > MAX_CONTRADICTIONS:
            return DockSearch(memory=search.memory, frame=search.frame, reason=reason)
        return replace(search, contradictions=count, solution=None, reason=reason)
    dock = dock_of(solution.geometry, solution.noise_ratio, now.place.stamp_ns)
    search = replace(search, contradictions=0, estimate=dock)
    if dock.deviation > settings.publish_deviation:
        reason = f'its place is uncertain by {dock.deviation:.3f} m; drive on'
        return replace(search, reason=reason)
    if dock.heading_deviation > settings.publish_heading:
        reason = f'its heading is uncertain by {math.degrees(dock.heading_deviation):.1f} deg'
        return replace(search, reason=reason)
    return replace(search, dock=dock, reason='')


def contradiction(solution: Solution) -> str:
    """Return what does not go together in a solution, in words, or ''."""
    if not solution.noise_ratio < CONTRADICTION:
        return f'views and path contradict each other by {solution.noise_ratio:.1f} deviations'
    if solution.inliers < LEAST_INLIERS:
        share = 100.0 * solution.inliers
        return f'only {share:.0f} % of the features are where the path puts them'
    return ''


def moved_enough(before: KeyView, now: KeyView, settings: DockPoseSettings) -> bool:
    """Return whether a view shows something new after another."""
    x, y, turn = relative_pose(before.place.pose, now.place.pose).tolist()
    return math.hypot(x, y) > settings.key_travel or abs(turn) > settings.key_turn


def thin_out(keys: Sequence[KeyView], most: int) -> tuple[KeyView, ...]:
    """Return ``keys`` less those whose neighbours are nearest each other, at most ``most``."""
    keys = list(keys)
    while len(keys) > most:
        gaps = [_gap(keys[k - 1], keys[k + 1]) for k in range(1, len(keys) - 1)]
        keys.pop(1 + int(np.argmin(gaps)))
    return tuple(keys)


def _gap(first: KeyView, last: KeyView) -> float:
    return last.place.way - first.place.way + 0.5 * (last.place.turn - first.place.turn)


def window_of(views: Sequence[KeyView], noise_px: float) -> KeyframeWindow:
    """Return what ``views``, in order of time, show of the features that are seen most often."""
    window = EMPTY
    for view in views:
        seen, noise = view.observation, noise_px * view.observation.resolution
        features = FeatureObservations(view.ids, seen.current, seen.desired, noise)
        window = window.with_view(features, view.place.pose[:2])
    often = np.argsort(-window.seen.sum(0), kind='stable')[:MOST_FEATURES]
    return window.of_features(np.isin(np.arange(len(window.ids)), often))


def factors_along(views: Sequence[KeyView], settings: DockPoseSettings) -> PathFactors:
    """Return what the path between ``views``, and the settings, tell beside the images."""
    pairs = list(zip(views[:-1], views[1:], strict=True))
    motions = [relative_pose(a.place.pose, b.place.pose) for a, b in pairs]
    weights = [_root(a.place, b.place, settings) for a, b in pairs]
    return PathFactors(
        settings.mount,
        len(views),
        way=0.0,
        scale_deviation=math.inf,
        motions=np.array(motions).reshape(-1, 3),
        weights=np.array(weights).reshape(-1, 3, 3),
        prior=np.append(settings.camera_place, 0.0),
        deviations=settings.path_deviations,
    )


def _root(before: PathPlace, after: PathPlace, settings: DockPoseSettings) -> FloatArray:
    """Return W, (3, 3), such that W^T W is the information of the motion between two places."""
    covariance = uncertainty(before, after, settings.path_deviation)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
