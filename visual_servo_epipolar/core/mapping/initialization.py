"""Initialization: the first geometry of the window, from the bearings of two views."""

from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.cheirality import VOTE_SATURATION
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING, USUAL_SQUARES
from visual_servo_epipolar.core.geometry.rotation import MIN_POINTS
from visual_servo_epipolar.core.geometry.wall import exchanged_bearings
from visual_servo_epipolar.core.mapping.factors import factors_of
from visual_servo_epipolar.core.mapping.fitting import (
    Anchors,
    fit_pose,
    MatchedFeatures,
)
from visual_servo_epipolar.core.mapping.projection import (
    points_of,
    project,
    structure_of,
    turns_of,
)
from visual_servo_epipolar.core.mapping.refinement import (
    DAMPING,
    Evaluation,
    Geometry,
    OUTLIER,
    refine,
    system_of,
)
from visual_servo_epipolar.core.mapping.window import (
    KeyframeWindow,
    MapSettings,
    MOUNT,
    PHOTOGRAPH,
    SHARED,
    Unknowns,
    VIEW,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude, LEAST_JITTER
from visual_servo_epipolar.core.twoview.hypotheses import SEPARATION

STEPS, LAST_STEPS, ROUNDS = 2, 30, 6
ALMOST = 1.5  # times the usual squares: converged but for rounding
MOST_NOISE = 2.0  # of residuals over the noise that is expected: else it is the wrong geometry
LIKELY = 4.0  # of cost, by which the likelier of two geometries must fit better
FIRST_TRUSTED = 0.6  # of the features to begin with: a wrong plane fits half of them
LEAST_AGREEING = 0.5  # of the trusted features in a view, or of the map's
LEAST_TRUSTED = 0.35  # of the features
MOST_DOUBT = 0.1  # deviation of a place over its distance, to begin with
FIRST_UNCERTAINTY = 0.3  # of depths from two views
FARTHEST = 10.0  # ways to the first view that another may be off
LEAST_DEPTH = 0.2  # of the way between the views


class Start(NamedTuple):
    """What two views tell of keyframe ``view``: its bearings, and the camera's attitude."""

    view: int
    bearings: Bearings
    attitude: Attitude


def initial_geometry(
    window: KeyframeWindow, starts: Sequence[Start], mount: Attitude, settings: MapSettings
) -> Geometry | None:
    """Return the geometry of a ``window`` that fits best; None if none does, or if two do."""

    def begun(window: KeyframeWindow, start: Start, starts: Sequence[Start]) -> Geometry | None:
        factors = factors_of(mount, window, settings)
        everything = np.ones(len(window.ids), bool)
        unknowns = _resected_views(window, start, starts)
        at, damping = refine_narrowing(
            orient_ahead(Evaluation(window, unknowns, everything, factors))
        )
        geometry = refine(orient_ahead(at), LAST_STEPS, damping)
        geometry = _of_held_views(geometry, settings)
        sound = len(geometry.window) > 1 and is_sound(geometry, FIRST_TRUSTED)
        return geometry if sound else None

    cost, last = attrgetter('evaluation.cost'), starts[-1]
    tried = [begun(window, start, starts) for start in starts if start.view == last.view]
    found = [each for each in tried if each is not None and is_sure(each)]
    if not found:
        return None
    fitting, best, before = found, min(found, key=cost), None
    while best is not before:  # from a twin that fits better, its own twin may fit better still
        exchanged, before = exchanged_starts(best, last.attitude), best
        twin = begun(best.window, exchanged[-1], exchanged) if exchanged else None
        fitting = [*fitting, twin] if twin else fitting
        # A geometry that needs views left out does not fit as well.
        fitting = [each for each in fitting if len(each.window) >= len(best.window)]
        best, *others = sorted(fitting, key=cost)
    # Of bearings without a rival two views show that they are true, as well.
    margin = LIKELY if len(tried) == 1 and best is found[0] else CONTRADICTING
    decided = best.converged and not any(is_rival(best, other, margin) for other in others)
    return refine(best.evaluation, 0, best.damping) if decided else None  # at the driven scale


def exchanged_starts(geometry: Geometry, attitude: Attitude) -> list[Start]:
    """
    Return the bearings of all views in the twin of a ``geometry``; none without a plane.

    Which of both it is, relief has to tell, or a third view far enough from both.
    """
    if int(geometry.trusted.sum()) <= MIN_POINTS:
        return []
    across, views = _plane(geometry)[[0, 2]], geometry.unknowns.views[:, :3]
    exchanged = [exchanged_bearings(view, across) for view in views]
    return [Start(k, each, attitude) for k, each in enumerate(exchanged) if each is not None]


def _plane(geometry: Geometry) -> FloatArray:
    """Return m, (3,), with m . X = 1 on the plane that fits trusted features best."""
    window, unknowns = geometry.window, geometry.unknowns
    rows = geometry.trusted
    rays = structure_of(window.photograph, window.tangents, unknowns).rays[:, rows]
    roots = geometry.system.roots[rows, 2]
    weight = 1.0 / np.sqrt((roots * roots).sum(1))
    near = unknowns.inverse_depth[rows]
    return np.asarray(np.linalg.lstsq((rays * weight).T, near * weight, rcond=None)[0])


def is_rival(best: Geometry, other: Geometry, margin: float = CONTRADICTING) -> bool:
    """Whether ``other`` fits nearly as well from other places: more views must tell."""
    if other.evaluation.cost > best.evaluation.cost + margin:
        return False
    first, second = (it.unknowns.views[-1, :2] for it in (best, other))
    angle = np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second)
    return bool(abs(angle) > SEPARATION)


def refine_narrowing(at: Evaluation) -> tuple[Evaluation, float]:
    """Return the geometry refined while the bound for outliers narrows, and its damping."""
    damping = DAMPING
    for _ in range(ROUNDS):
        seen = at.window.seen
        widening = float(np.median(at.squares[seen])) / USUAL_SQUARES if seen.any() else 1.0
        if widening < ALMOST:
            break
        wide = refine(replace(at, widening=widening), STEPS, damping)
        at, damping = replace(wide.evaluation, trusted=at.trusted), wide.damping
    return replace(at, widening=1.0), damping


def orient_ahead(at: Evaluation) -> Evaluation:
    """Return the geometry of which features lie ahead, of two that look the same."""
    roots = system_of(at).roots[:, 2]
    deviations = at.unknowns.inverse_depth / np.sqrt((roots * roots).sum(1))
    vote = float(np.clip(deviations, -VOTE_SATURATION, VOTE_SATURATION) @ at.trusted)
    return at if vote >= 0.0 else replace(at, unknowns=at.unknowns.scaled(-1.0))


def is_sound(geometry: Geometry, trusted: float = LEAST_TRUSTED) -> bool:
    """Whether residuals are noise, in every view, and a share of features is ``trusted``."""
    share = geometry.trusted.mean() if len(geometry.trusted) else 0.0
    held = bool(held_views(geometry).all())
    return held and geometry.noise_ratio < MOST_NOISE and float(share) >= trusted


def is_sure(geometry: Geometry) -> bool:
    """Whether the last view's place is known to a share of its distance, but for the scale."""
    root, place = geometry.root, geometry.unknowns.views[-1, :2]
    along = geometry.evaluation.factors.by_scale(geometry.unknowns) @ root
    first = VIEW * (len(geometry.window) - 1)
    last = root[first : first + 2]
    last = last - np.outer(last @ along, along / (along @ along))
    return bool((last * last).sum() <= MOST_DOUBT**2 * float(place @ place))


def held_views(geometry: Geometry) -> BoolArray:
    """Return the views in which most of the trusted features agree, (K,)."""
    seen = geometry.window.seen & geometry.trusted
    agree = (seen & (geometry.evaluation.squares <= OUTLIER)).sum(1)
    return np.asarray(agree >= LEAST_AGREEING * np.maximum(seen.sum(1), 1))


def _of_held_views(geometry: Geometry, settings: MapSettings) -> Geometry:
    """Return the geometry without the views that do not fit the rest."""
    held = held_views(geometry)
    if held.all() or held.sum() < 2:
        return geometry
    window, unknowns = geometry.window, geometry.unknowns
    for k in np.flatnonzero(~held)[::-1].tolist():
        window = window.without_view(k)
    kept = np.asarray(window.seen.any(0))
    window = window.of_features(kept)
    unknowns = replace(unknowns, views=unknowns.views[held]).of_features(kept)
    factors = factors_of(geometry.evaluation.factors.mount, window, settings)
    everything = np.ones(len(window.ids), bool)
    return refine(Evaluation(window, unknowns, everything, factors), LAST_STEPS)


def _resected_views(window: KeyframeWindow, start: Start, starts: Sequence[Start]) -> Unknowns:
    """Return all views by features whose depths are those that one of them shows."""
    attitude = np.array([start.attitude.tilt, start.attitude.roll])
    psi, heading = start.bearings.psi, start.bearings.heading_error
    views = np.zeros((len(window), VIEW))
    views[:, 2], views[:, 3:] = heading, attitude
    views[start.view, :2] = np.cos(psi), np.sin(psi)
    count = len(window.ids)
    unknowns = Unknowns(views, shared_at(attitude), np.zeros((2, count)), np.ones(count))
    near = triangulate(window, unknowns, np.arange(len(window)) == start.view)
    unknowns = Unknowns(views, unknowns.shared, unknowns.offsets, near)
    structure = structure_of(window.photograph, window.tangents, unknowns)
    covariance = np.zeros((3, 3, count))
    covariance[[0, 1], [0, 1]], covariance[2, 2] = 1.0, (FIRST_UNCERTAINTY * near) ** 2
    deviation = np.full(2, max(2.0 * start.attitude.jitter, LEAST_JITTER))
    anchors = Anchors(structure, covariance, attitude, deviation)
    order = [*range(start.view + 1, len(window)), *range(start.view - 1, -1, -1)]
    for k in order:
        neighbour = k - 1 if k > start.view else k + 1
        guesses = [guess_pose(views[neighbour], it.bearings) for it in starts if it.view == k]
        guesses = guesses or [views[neighbour]]
        views[k] = guesses[0]
        rows = np.flatnonzero(window.seen[k] & window.seen[start.view])
        if len(rows) >= MIN_POINTS:
            seen = MatchedFeatures(
                rows, window.rays[k][:, rows], window.tangent_basis[k][..., rows]
            )
            fits = [fit_pose(anchors.of(rows), seen, guess) for guess in guesses]
            pose = min(fits, key=lambda fit: float(np.minimum(fit.squares, OUTLIER).sum())).pose
            if np.hypot(*pose[:2]) < FARTHEST:  # else others would start from nowhere
                views[k] = pose
    every = triangulate(window, unknowns, np.ones(len(window), bool))
    return Unknowns(views, unknowns.shared, unknowns.offsets, every)


def shared_at(attitude: FloatArray) -> FloatArray:
    """Return the shared unknowns of a camera at an attitude, (2,), on an even floor."""
    shared = np.zeros(SHARED)
    shared[PHOTOGRAPH] = shared[MOUNT] = attitude
    return shared


def guess_pose(near: FloatArray, bearings: Bearings) -> FloatArray:
    """Return where a view may be that is as far off as one ``near``, by its ``bearings``."""
    view, distance = near.copy(), np.hypot(near[0], near[1])
    view[:2] = distance * np.cos(bearings.psi), distance * np.sin(bearings.psi)
    view[2] = bearings.heading_error
    return np.asarray(view)


def triangulate(window: KeyframeWindow, unknowns: Unknowns, views: BoolArray) -> FloatArray:
    """Return inverse depths, (N,), that fit best what ``views``, (K,), show at their poses."""
    structure = structure_of(window.photograph, window.tangents, unknowns)
    flat = structure._replace(inverse_depth=np.zeros(len(window.ids)))
    chosen, tangent_basis = unknowns.views[views], window.tangent_basis[views]
    # r = (s . R ray - near s . R place), in deviations where all is far off.
    far = project(flat, chosen, tangent_basis).residuals
    moved = structure._replace(rays=0.0 * structure.rays, inverse_depth=np.ones(len(window.ids)))
    places = turns_of(chosen, structure.stretch) @ points_of(moved, chosen)
    by_near = (tangent_basis * places[:, None]).sum(2)
    weight = window.seen[views][:, None]
    information = (weight * by_near * by_near).sum((0, 1))
    near = -(weight * by_near * far).sum((0, 1)) / np.maximum(information, 1.0)
    reach = np.hypot(chosen[:, 0], chosen[:, 1]).max()
    return np.asarray(np.clip(near, 1e-3 / reach, 1.0 / (LEAST_DEPTH * reach)))
