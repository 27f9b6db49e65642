"""Gauss-Newton on rotation and direction of the baseline of many general motions at once."""

from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.machinery.hypotheses import INLIER_DEVIATIONS, Rays
from visual_servo_epipolar.core.estimators.machinery.refinement import LARGEST_STEP, TUKEY
from visual_servo_epipolar.core.estimators.machinery.sampson import linearised
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.geometry.rays import normalised

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
    weighted = slopes * weight[:, None]
    information = weighted @ slopes.swapaxes(-1, -2) + RIDGE * np.eye(UNKNOWNS)
    pull = weighted @ residual[..., None]
    change = np.negative(np.linalg.solve(information, pull)[..., 0])
    after = changed(motions, tangents, change)
    return GeneralStep(after, information, residual, weight, slopes, tangents)


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
    slopes, turns = now.slopes[:, :3], now.information[:, :3, :3]
    pull = (slopes * (now.weight * now.residual)[:, None]).sum(axis=-1)
    change = -np.linalg.solve(turns, pull[..., None])[..., 0]
    change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
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
