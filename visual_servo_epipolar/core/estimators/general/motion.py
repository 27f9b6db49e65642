"""
Motion of a camera in the hand: any rotation, any direction of the baseline.

Five-point hypotheses, the best different ones refined by Gauss-Newton on the angular Sampson
distance with Tukey weights, at the scale that the residuals show. Matches whose depths have the
wrong sign, as look-alikes along the epipolar line have, count as wrong. Rotations R carry current
into desired rays; the baseline, unit t, is the current centre in axes of the desired camera:
E = [t]x R.
"""

from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.machinery.five_point import (
    decomposed,
    essential_matrices,
    samples_of_five,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import INLIER_DEVIATIONS, Rays
from visual_servo_epipolar.core.estimators.machinery.refinement import LARGEST_STEP
from visual_servo_epipolar.core.estimators.machinery.sampson import (
    linearised,
    squared_distances,
    table_of,
)
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.geometry.least_squares import Equations, TUKEY
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.geometry.rotation import fit_rotation

SAMPLES = 400  # of five matches
COUNTED = 300  # matches by which hypotheses are distinguished
MIN_MATCHES = 8
ROUGH_PX = 2.0  # noise with which hypotheses of noisy samples are distinguished
FIRST_PX = 1.0  # and from which on the scale is found
STARTS, MODES = 24, 12  # hypotheses that are refined, and how many to the end
SCALES = (0.2, 0.35, 0.7, 1.4)  # of the noise that are compared [px]
RIGHT, ANYWHERE_PX = 0.8, 3.0  # matches that are right; how far others are from their line
ALIKE = 0.995  # cosine between E by rows that are one hypothesis
APART = 0.01  # between refined modes: of R, and of t [rad]
DIRECTIONS = 40  # of a baseline that hardly shows, to start from
WIDTHS = (4.0, 3.0, 2.0, 1.5, 1.2, 1.0)  # of the noise, step by step
LAST = (1.5, 1.2, 1.0, 1.0, 1.0, 1.0, 1.0)
WORST = INLIER_DEVIATIONS**2
RIDGE = 1e-3  # information that keeps equations regular: a deviation of 30 rad
LEAST_SCALE = 0.15  # noise [px] below which residuals are not believed
MEDIAN = 0.6612  # of |x| of a normal x cut off at INLIER_DEVIATIONS
ROUNDS = 4
DEPTH_DEVIATIONS = 3.0  # along its line, by which a match is on the wrong side
NEAR_EPIPOLE = 1e-3  # sine of the angle from it within which depths have no sign
UNKNOWNS = 5
AXES = cross_matrix(np.eye(3))  # of the three turns


class Motions(NamedTuple):
    """Rotations current -> desired, shape (K, 3, 3), and unit baselines, (K, 3)."""

    rotation: FloatArray
    baseline: FloatArray

    def take(self, rows: Any) -> 'Motions':
        """Return the motions chosen by index or mask."""
        return Motions(*(part[rows] for part in self))


class GeneralStep(NamedTuple):
    """
    Motions after a step; before it: weighted rows, and how a parameter changes residuals.

    ``information`` is (K, 5, 5): three angles of R about desired axes, then two of t along
    ``tangents``, (K, 2, 3). ``residual`` and ``weight`` have shape (K, N), ``slopes`` (K, 5, N).
    """

    motions: Motions
    information: FloatArray
    residual: FloatArray
    weight: FloatArray
    slopes: FloatArray
    tangents: FloatArray


class GeneralFit(NamedTuple):
    """
    Refined motions, the best first, of shape (K, ...), from N matches.

    ``costs``, (K,), are sums of truncated squared distances in deviations of ``scale`` [px], with
    the worst of each match whose depths have the wrong sign; ``inliers``, (K, N), agree.
    """

    motions: Motions
    costs: FloatArray
    inliers: BoolArray
    scale: float
    table: FloatArray


def general_motion(rays: Rays) -> GeneralFit:
    """
    Return the motions that explain matches best; ``rays`` have the angle of one pixel as noise.

    Raises
    ------
    DegenerateGeometryError
        With fewer than eight matches.

    """
    if rays.matches < MIN_MATCHES:
        raise DegenerateGeometryError(
            f'a general motion needs {MIN_MATCHES} matches, got {rays.matches}'
        )
    table = table_of(rays)
    motions = _starts(rays, table)
    scale = FIRST_PX
    for width in WIDTHS:
        motions = step(motions, table, width * scale).motions
        if width < 2.0:
            scale = _scale(motions, rays, table, scale)
    motions, _ = _best(motions, rays, table, scale, MODES)
    motions, scale = _likeliest(motions, rays, table)
    for width in LAST:
        motions = step(motions, table, width * scale).motions
        scale = _scale(motions, rays, table, scale)
    return _fit(motions, rays, table, scale)


def _likeliest(motions: Motions, rays: Rays, table: FloatArray) -> tuple[Motions, float]:
    """
    Return motions refined at several scales, the likeliest first, and the scale of that one.

    A look-alike explains some matches well and others nearly: a scale wide enough for it hides
    that the truth explains as many by noise alone. Likelihoods, of noise beside matches anywhere
    within ``ANYWHERE_PX`` of the line, compare scales as well.
    """
    refined = []
    for scale in SCALES:
        at_scale = motions
        for width in LAST:
            at_scale = step(at_scale, table, width * scale).motions
        refined.append(at_scale)
    motions = _joined(*refined)
    squared, wrong = _squared(motions, rays, table, 1.0)
    losses = np.stack([_loss(squared, wrong, scale) for scale in SCALES])
    order = losses.min(axis=0).argsort(kind='stable')
    best = int(losses[:, order[0]].argmin())
    return motions.take(order[: 2 * MODES]), SCALES[best]


def _loss(squared: FloatArray, wrong: BoolArray, scale: float) -> FloatArray:
    """Return the negative logarithms of likelihoods, (K,), of noise of ``scale`` [px]."""
    peak = RIGHT / (scale * np.sqrt(2.0 * np.pi))
    density = np.where(wrong, 0.0, peak * np.exp(-0.5 * squared / scale**2))
    loss = -np.log(density + 0.5 * (1.0 - RIGHT) / ANYWHERE_PX).sum(axis=1)
    return np.asarray(np.where(np.isfinite(loss), loss, np.inf))


def _fit(motions: Motions, rays: Rays, table: FloatArray, scale: float) -> GeneralFit:
    motions, costs = _best(motions, rays, table, scale, MODES)
    squared, wrong = _squared(motions, rays, table, scale)
    return GeneralFit(motions, costs, (squared <= WORST) & ~wrong, scale, table)


def improved(fit: GeneralFit, starts: Motions, rays: Rays) -> GeneralFit:
    """Return the fit after ``starts`` were refined as well: at its scale, then at their own."""
    scale = fit.scale
    for width in LAST:
        starts = step(starts, fit.table, width * scale).motions
    motions = _joined(fit.motions, starts)
    scale = _scale(motions, rays, fit.table, scale)
    return _fit(motions, rays, fit.table, scale)


def _scale(motions: Motions, rays: Rays, table: FloatArray, scale: float) -> float:
    """Return the noise [px] that the residuals of the best motion show."""
    squared, wrong = _squared(motions, rays, table, scale)
    best = int(_costs(squared, wrong).argmin())
    return scale_of(scale * np.sqrt(squared[best]), scale)


def costs_of(motions: Motions, rays: Rays, table: FloatArray, scale: float) -> FloatArray:
    """Return the costs of motions, (K,), as ``GeneralFit`` has them."""
    return _costs(*_squared(motions, rays, table, scale))


def losses_of(fit: GeneralFit, rays: Rays) -> FloatArray:
    """Return what each match, (K, N), costs each motion of a fit."""
    return _losses(*_squared(fit.motions, rays, fit.table, fit.scale))


def cost_of_essential(essential: FloatArray, fit: GeneralFit, rays: Rays) -> float:
    """Return the cost of E, shape (3, 3), as ``GeneralFit`` has them: of the better motion."""
    motions = twins(_motions(essential[None]))
    return float(costs_of(motions, rays, fit.table, fit.scale).min())


def plain_cost(fundamental: FloatArray, fit: GeneralFit) -> float:
    """Return the truncated cost of F for rays, shape (3, 3), whatever depths say."""
    squared = squared_distances(fundamental.reshape(1, 9), fit.table) / fit.scale**2
    return float(np.minimum(squared, WORST).sum())


def _costs(squared: FloatArray, wrong: BoolArray) -> FloatArray:
    costs = _losses(squared, wrong).sum(axis=1)
    return np.asarray(np.where(np.isfinite(costs), costs, WORST * squared.shape[1]))


def _losses(squared: FloatArray, wrong: BoolArray) -> FloatArray:
    return np.where(wrong, WORST, np.minimum(squared, WORST))


def _squared(
    motions: Motions, rays: Rays, table: FloatArray, scale: float
) -> tuple[FloatArray, BoolArray]:
    """Return squared distances in deviations, (K, N), and which matches have wrong depths."""
    squared = squared_distances(essentials(motions).reshape(-1, 9), table) / scale**2
    return squared, wrong_depths(motions, rays, scale)


def _best(
    motions: Motions, rays: Rays, table: FloatArray, scale: float, count: int
) -> tuple[Motions, FloatArray]:
    """Return at most ``count`` different motions, each with the better twin, and their costs."""
    motions = twins(motions)
    squared, wrong = _squared(motions, rays, table, scale)
    costs = _costs(squared, wrong)
    chosen: list[int] = []
    for place in costs.argsort(kind='stable').tolist():
        if len(chosen) == count:
            break
        if all(_apart(motions, place, other) for other in chosen):
            chosen.append(place)
    return motions.take(np.array(chosen)), costs[chosen]


def _apart(motions: Motions, one: int, other: int) -> bool:
    away = motions.rotation[one] - motions.rotation[other]
    change = motions.baseline[one] - motions.baseline[other]
    return bool(max(np.abs(away).max(), np.abs(change).max()) > APART)


def _starts(rays: Rays, table: FloatArray) -> Motions:
    """Return the best hypotheses: by five matches, and the best rotation with any baseline."""
    essential = essential_matrices(rays, samples_of_five(rays.matches, SAMPLES))
    rows = essential.reshape(-1, 9)
    turned = _turned(rays)
    if not len(rows):
        return turned
    counted = np.arange(0, rays.matches, max(rays.matches // COUNTED, 1))
    some = table.reshape(9, 5, -1)[:, :, counted].reshape(9, -1)
    squared = squared_distances(rows, some) / ROUGH_PX**2
    order = np.minimum(squared, WORST).sum(axis=1).argsort(kind='stable')
    chosen = _different(rows, order)
    return _joined(_motions(essential[chosen]), turned)


def _different(rows: FloatArray, order: IntArray) -> IntArray:
    """Return the places, in ``order``, of E by rows, (K, 9), unit norm, that differ."""
    chosen: list[int] = []
    for place in order.tolist():
        if len(chosen) == STARTS:
            break
        if not chosen or np.abs(rows[chosen] @ rows[place]).max() < ALIKE:
            chosen.append(place)
    return np.array(chosen, dtype=np.int64)


def _turned(rays: Rays) -> Motions:
    """Return motions with the best rotation and a baseline in any direction."""
    current = np.stack([rays.x_a, rays.y_a, rays.z_a], axis=-1)
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d], axis=-1)
    rotation = fit_rotation(current, desired).rotation
    k = np.arange(DIRECTIONS) + 0.5  # a spiral over half a sphere
    height = k / DIRECTIONS
    angle = np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - height * height)
    baseline = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    return Motions(np.repeat(rotation[None], DIRECTIONS, axis=0), baseline)


def _motions(essential: FloatArray) -> Motions:
    """Return one of the motions of each E, shape (K, 3, 3): the other is its twin."""
    if not len(essential):
        return Motions(np.empty((0, 3, 3)), np.empty((0, 3)))
    baseline, both = decomposed(essential)
    return Motions(both[0], baseline)


def _joined(*parts: Motions) -> Motions:
    columns: Any = zip(*parts, strict=True)
    return Motions(*(np.concatenate(column) for column in columns))


def essentials(motions: Motions) -> FloatArray:
    """Return E = [t]x R, shape (K, 3, 3)."""
    return np.asarray(cross_matrix(motions.baseline) @ motions.rotation)


def twins(motions: Motions) -> Motions:
    """Return all motions of the same E: t or -t, R or R turned by half around t; (4 K, ...)."""
    rotation, baseline = motions
    half = 2.0 * baseline[:, :, None] * baseline[:, None] - np.eye(3)
    other = half @ rotation
    return Motions(
        np.concatenate([rotation, rotation, other, other]),
        np.concatenate([baseline, -baseline, baseline, -baseline]),
    )


def step(motions: Motions, table: FloatArray, scale: float) -> GeneralStep:
    """Return a step of Gauss-Newton, Tukey weights at a noise of ``scale`` [px]."""
    rotation, baseline = motions
    tangents = _tangents(baseline)
    across = cross_matrix(baseline)
    stack = np.empty((len(baseline), 1 + UNKNOWNS, 3, 3))
    stack[:, 0] = across @ rotation
    stack[:, 1:4] = across[:, None] @ AXES @ rotation[:, None]
    stack[:, 4:] = cross_matrix(tangents) @ rotation[:, None]
    rows, squared_gradient = linearised(stack.reshape(len(baseline), -1, 9), table)
    rows /= np.sqrt(squared_gradient)[:, None]
    residual, slopes = rows[:, 0], rows[:, 1:]
    weight = np.maximum(1.0 - (residual / (TUKEY * scale)) ** 2, 0.0) ** 2
    equations = Equations.of(rows * np.sqrt(weight)[:, None], RIDGE * np.eye(UNKNOWNS))
    after = changed(motions, tangents, -equations.change())
    return GeneralStep(after, equations.information, residual, weight, slopes, tangents)


def changed(motions: Motions, tangents: FloatArray, change: FloatArray) -> Motions:
    """Return motions after a ``change``, (K, 5), of the parameters of ``GeneralStep``."""
    change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
    return Motions(
        _rotations(change[:, :3]) @ motions.rotation,
        normalised(motions.baseline + (change[:, 3:, None] * tangents).sum(axis=1)),
    )


def turned_only(motions: Motions, table: FloatArray, scale: float) -> Motions:
    """Return motions, their rotations a step better, their baselines as they are."""
    now = step(motions, table, scale)
    rows = np.concatenate([now.residual[:, None], now.slopes[:, :3]], axis=1)
    equations = Equations.of(rows * np.sqrt(now.weight)[:, None], RIDGE * np.eye(3))
    change = np.clip(-equations.change(), -LARGEST_STEP, LARGEST_STEP)
    return Motions(_rotations(change) @ motions.rotation, motions.baseline)


def scale_of(distances: FloatArray, scale: float) -> float:
    """Return the noise [px] of ``distances``, (N,), of which many are no noise: from ``scale``."""
    distances = np.abs(distances)
    for _ in range(ROUNDS):
        within = distances[distances <= INLIER_DEVIATIONS * scale]
        if len(within) <= UNKNOWNS:
            break
        spare = len(within) / (len(within) - UNKNOWNS)
        scale = max(float(np.median(within)) / MEDIAN * spare**0.5, LEAST_SCALE)
    return scale


def wrong_depths(motions: Motions, rays: Rays, scale: float) -> BoolArray:
    """
    Return which matches, shape (K, N), lie behind a camera by more than noise.

    A match moves along its epipolar line from where it would be at infinity. The other way there
    is nothing. Unit rays have depths along them, behind the camera as well.
    """
    current = np.stack([rays.x_a, rays.y_a, rays.z_a])
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d])
    turned = motions.rotation @ current  # (K, 3, N)
    normal = np.cross(desired[None], turned, axis=1)
    limit = DEPTH_DEVIATIONS * scale * np.sqrt(rays.noise_a**2 + rays.noise_d**2)
    wrong = np.zeros(normal[:, 0].shape, bool)
    for ray in (np.broadcast_to(desired[None], turned.shape), turned):
        across = np.cross(ray, motions.baseline[:, :, None], axis=1)
        size = np.sqrt((across * across).sum(axis=1))
        along = (normal * across).sum(axis=1) / np.maximum(size, NEAR_EPIPOLE)
        wrong |= (along > limit) & (size > NEAR_EPIPOLE)
    return wrong


def _tangents(baseline: FloatArray) -> FloatArray:
    """Return two unit vectors across each baseline, shape (K, 2, 3)."""
    other = np.where(np.abs(baseline[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = normalised(np.cross(baseline, other))
    return np.stack([first, np.cross(baseline, first)], axis=1)


def _rotations(angles: FloatArray) -> FloatArray:
    """Return rotations by vectors of half tangents (Cayley), shape (K, 3): (K, 3, 3)."""
    half = 0.5 * cross_matrix(angles)
    eye = np.eye(3)
    return np.asarray(np.linalg.solve(eye - half, np.broadcast_to(eye, half.shape) + half))
