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
from visual_servo_epipolar.core.estimators.general.steps import (
    essentials,
    Motions,
    scale_of,
    step,
    twins,
    wrong_depths,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import INLIER_DEVIATIONS, Rays
from visual_servo_epipolar.core.estimators.machinery.sampson import squared_distances, table_of
from visual_servo_epipolar.core.estimators.machinery.search.five_point import (
    essential_matrices,
    samples,
)
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
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
    essential = essential_matrices(rays, samples(rays.matches, SAMPLES))
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
    u, _, vt = np.linalg.svd(essential)
    u[..., 2] *= np.sign(np.linalg.det(u))[:, None]
    vt[..., 2, :] *= np.sign(np.linalg.det(vt))[:, None]
    quarter = cross_matrix(np.array([0.0, 0.0, 1.0])) + np.diag([0.0, 0.0, 1.0])
    return Motions(u @ quarter @ vt, u[..., 2])


def _joined(*parts: Motions) -> Motions:
    columns: Any = zip(*parts, strict=True)
    return Motions(*(np.concatenate(column) for column in columns))
