"""The search for the dock: views of the photograph along the path become its pose."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.docking.dock_pose import dock_of, DockPose
from visual_servo_epipolar.core.docking.key_views import (
    factors_along,
    KeyView,
    moved_enough,
    thin_out,
    window_of,
)
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.geometry.planar_poses import (
    camera_at,
    compose,
    inverse_pose,
    relative_pose,
)
from visual_servo_epipolar.core.mapping.adjustment.equations import Evaluation, OUTLIER
from visual_servo_epipolar.core.mapping.adjustment.factors import (
    camera_poses,
    ON_BASE,
    PathFactors,
    views_of,
)
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry, refine
from visual_servo_epipolar.core.mapping.adjustment.window import (
    KeyframeWindow,
    PHOTOGRAPH,
    Unknowns,
)
from visual_servo_epipolar.core.mapping.initialization import (
    refine_narrowing,
    shared_at,
    triangulate,
)
from visual_servo_epipolar.core.odometry.path import PathPlace
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
