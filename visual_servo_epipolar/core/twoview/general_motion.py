"""
Motion of a camera in the hand: any rotation, any direction of the baseline, and its deviation.

OpenCV's USAC finds what may be, least squares on the angular Sampson distance with Tukey's weights
refine it, at the scale that the residuals show. Matches whose depths have the wrong sign, as
look-alikes along the epipolar line have, count as wrong. Rotations R carry current into desired
rays; the baseline, unit t, is the current centre in axes of the desired camera: E = [t]x R.

The covariance is that of residuals with their own tails, not those of a model, and as they err
together in parts of the image. Errors of the camera file move all residuals, and no number of
matches averages them out.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import (
    cross_matrix,
    decomposed,
    MIN_MATCHES,
    MOTION_PARAMETERS,
)
from visual_servo_epipolar.core.geometry.least_squares import (
    CONTRADICTING,
    deviation_of,
    Equations,
    least_squares,
    likeliest_noise,
    TUKEY,
)
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, headings
from visual_servo_epipolar.core.geometry.significance import together
from visual_servo_epipolar.core.tracking.robust_geometry import essential_matrices
from visual_servo_epipolar.core.twoview.hypotheses import Rays, rays_of, WORST
from visual_servo_epipolar.core.twoview.planar_motion import behind
from visual_servo_epipolar.core.twoview.refinement import (
    LARGEST_STEP,
    linearised,
    MODES,
    RIDGE,
    squared_distances,
    table_of,
)

WIDTHS = np.array([4.0, 3.0, 2.0, 1.5, 1.2, *[1.0] * 5])  # of the noise, step by step
FIRST_SCALE, LEAST_SCALE = 0.5, 0.15  # noise [px] that is begun with, and at least believed
AXES = cross_matrix(np.eye(3))  # of the three turns
RADII = np.radians([0.3, 0.7, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0])  # around the best direction
FEW = 0.05  # of the matches, on which alone no answer may hang
# What lens, shutter and focus give residuals of all matches alike [px], of images whose pixels are
# no larger than this [rad]: larger ones are binned, and neither lens nor hand is worse.
SHARED_PX, LARGEST_PIXEL = 0.05, 1.0 / 400.0


class Motions(NamedTuple):
    """Rotations current -> desired, shape (K, 3, 3), and unit baselines, (K, 3)."""

    rotation: FloatArray
    baseline: FloatArray

    @classmethod
    def of(cls, essentials: FloatArray) -> 'Motions':
        """Return one motion of each E, shape (K, 3, 3); the others are its twins."""
        baseline, both = decomposed(essentials)
        return cls(both[0], baseline)

    def take(self, rows: Any) -> 'Motions':
        """Return the motions chosen by index or mask."""
        return Motions(*(part[rows] for part in self))

    def joined(self, other: 'Motions') -> 'Motions':
        """Return these motions and others."""
        return Motions(*map(np.concatenate, zip(self, other, strict=True)))

    @property
    def essentials(self) -> FloatArray:
        """E = [t]x R, shape (K, 3, 3)."""
        return np.asarray(cross_matrix(self.baseline) @ self.rotation)

    @property
    def bearings(self) -> FloatArray:
        """Bearings, current and desired, and heading [rad], shape (K, 3)."""
        goal = -(self.baseline[:, None] @ self.rotation)[:, 0]
        towards = [np.arctan2(each[:, 0], each[:, 2]) for each in (goal, self.baseline)]
        return np.stack([*towards, headings(self.rotation)], axis=-1)

    @property
    def tangents(self) -> FloatArray:
        """Two unit vectors across each baseline, shape (K, 2, 3)."""
        baseline = self.baseline
        other = np.where(np.abs(baseline[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        first = normalised(np.cross(baseline, other))
        return np.stack([first, np.cross(baseline, first)], axis=1)

    def changed(self, change: FloatArray) -> 'Motions':
        """Return motions changed by angles of R, and of t along the tangents, shape (K, 5)."""
        change = np.clip(change, -LARGEST_STEP, LARGEST_STEP)
        half = 0.5 * cross_matrix(change[:, :3])  # Cayley
        turns = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
        moves = (change[:, 3:, None] * self.tangents).sum(axis=1)
        return Motions(turns @ self.rotation, normalised(self.baseline + moves))

    def turned(self, rotation: FloatArray) -> 'Motions':
        """Return the motions in axes that a ``rotation``, (3, 3), turns both cameras to."""
        return Motions(rotation @ self.rotation @ rotation.T, self.baseline @ rotation.T)

    @property
    def twins(self) -> 'Motions':
        """All motions of the same E: t or -t, R or R turned by half around t; (4 K, ...)."""
        rotation, baseline = self
        half = 2.0 * baseline[:, :, None] * baseline[:, None] - np.eye(3)
        both = np.concatenate([rotation, half @ rotation])
        return Motions(
            np.tile(both, (2, 1, 1)), np.concatenate([baseline, baseline, -baseline, -baseline])
        )


class GeneralFit(NamedTuple):
    """
    Refined ``motions``, the best first, of shape (K, ...), from N matches.

    ``rays`` have the angle of a pixel as noise, ``table`` is of them, and residuals have a
    deviation of ``scale`` [px].
    """

    rays: Rays
    table: FloatArray
    motions: Motions
    scale: float

    @property
    def best(self) -> Motions:
        """The best motion, of shape (1, ...)."""
        return self.motions.take(slice(1))

    @property
    def inliers(self) -> BoolArray:
        """Which matches agree with the best motion, shape (N,)."""
        return np.asarray(self.losses(self.best)[0] < WORST)

    def losses(self, motions: Motions) -> FloatArray:
        """Return truncated squared distances in deviations, (K, N), the worst of wrong depths."""
        losses = self.plain_losses(motions.essentials)
        return np.where(wrong_depths(motions, self.rays, self.scale), WORST, losses)

    def plain_losses(self, essentials: FloatArray) -> FloatArray:
        """Return truncated squared distances from E, (K, 3, 3), whatever depths say: (K, N)."""
        return np.minimum((self.distances(essentials) / self.scale) ** 2, WORST)

    def distances(self, essentials: FloatArray) -> FloatArray:
        """Return the distances from E, (K, 3, 3): (K, N) [px]."""
        return np.sqrt(squared_distances(essentials.reshape(-1, 9), self.table))

    def rows(self, motions: Motions) -> FloatArray:
        """Return residuals [px] and their derivatives by five parameters, (K, 6, N)."""
        rotation, across = motions.rotation, cross_matrix(motions.baseline)
        stack = np.empty((len(rotation), 6, 3, 3))
        stack[:, 0] = across @ rotation
        stack[:, 1:4] = across[:, None] @ AXES @ rotation[:, None]
        stack[:, 4:] = cross_matrix(motions.tangents) @ rotation[:, None]
        rows, gradient = linearised(stack.reshape(-1, 6, 9), self.table)
        return np.asarray(rows / np.sqrt(gradient)[:, None])

    def weight(self, residual: FloatArray, width: float = 1.0) -> FloatArray:
        """Return the root of Tukey's weight of residuals [px] at a wider noise."""
        return np.maximum(1.0 - (residual / (TUKEY * self.scale * width)) ** 2, 0.0)

    def refined(
        self, motions: Motions, widths: FloatArray, unknowns: int = MOTION_PARAMETERS
    ) -> Motions:
        """Return motions, or with 3 ``unknowns`` their rotations, after steps at ``widths``."""

        def linearise(now: Motions, number: int) -> Equations:
            rows = self.rows(now)[:, : 1 + unknowns]
            weight = self.weight(rows[:, 0], widths[number])
            return Equations.of(rows * weight[:, None], RIDGE * np.eye(unknowns))

        def moved(now: Motions, at: Equations, change: FloatArray) -> tuple[Motions, bool]:
            return now.changed(np.pad(-change, ((0, 0), (0, MOTION_PARAMETERS - unknowns)))), False

        return least_squares(motions, linearise, moved, len(widths))[0]

    def settled(self) -> 'GeneralFit':
        """Return the fit after steps at a ``scale`` that follows the residuals of the best."""
        fit = self
        for width in WIDTHS[3:]:
            fit = fit._replace(motions=fit.refined(fit.motions, np.array([width]))).sorted()
            losses = fit.losses(fit.best)[0]
            within = fit.scale * np.sqrt(losses[losses < WORST])
            if len(within) > MOTION_PARAMETERS:
                noise = deviation_of(float(np.median(within)), len(within) - MOTION_PARAMETERS)
                fit = fit._replace(scale=max(noise, LEAST_SCALE))
        return fit

    def sorted(self) -> 'GeneralFit':
        """Return the fit with the better twin of each motion, the best one first."""
        twins, count = self.motions.twins, len(self.motions.baseline)
        costs = self.losses(twins).sum(axis=1).reshape(4, count)
        better = costs.argmin(axis=0) * count + np.arange(count)
        return self._replace(motions=twins.take(better[costs.min(axis=0).argsort()]))


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
    by_usac = Motions.of(essential_matrices(rays.current, rays.desired, float(rays.mean_noise)))
    rotation = fit_rotation(rays.current, rays.desired).rotation
    starts = by_usac.joined(_in_any_direction(rotation))
    fit = GeneralFit(rays, table_of(rays), starts, FIRST_SCALE)
    return fit._replace(motions=fit.refined(starts, 2.0 * WIDTHS)).sorted().settled()


def _in_any_direction(rotation: FloatArray) -> Motions:
    """Return motions of a ``rotation``, (3, 3), ahead, aside and between, from which to start."""
    angles = np.linspace(0.0, np.pi, 4, endpoint=False)
    baseline = np.stack([np.sin(angles), np.zeros(4), np.cos(angles)], axis=1)
    return Motions(np.repeat(rotation[None], 4, axis=0), baseline)


def noise_of_small_baseline(
    current: FloatArray,
    desired: FloatArray,
    resolution: FloatArray,
    rotation: FloatArray,
    noise: float,
) -> float:
    """
    Return the noise [px] of matches, near ``noise``, whose baseline may be as small as it.

    Unit rays have shape (N, 3), the angles of a pixel at them (N, 2).
    Refined from several directions in the plane of motion, with the best ``rotation``, (3, 3).
    Where the direction is lost in the noise, distances are those of the noise all the same.
    """
    rays = rays_of(current, desired, resolution)
    start = _in_any_direction(rotation)
    fit = GeneralFit(rays, table_of(rays), start, noise)
    motions = fit.refined(start, np.ones(3))
    best = fit.plain_losses(motions.essentials).sum(axis=1).argmin()
    return likeliest_noise(fit.distances(motions.essentials)[best], noise)


def wrong_depths(motions: Motions, rays: Rays, scale: float) -> BoolArray:
    """
    Return which matches, shape (K, N), lie behind a camera by more than noise.

    Unit rays have depths along them, behind the camera as well.
    """
    turned, desired = motions.rotation @ rays.current.T, rays.desired.T  # (K, 3, N)
    ahead = (motions.baseline[:, None] @ turned)[:, 0]
    between = (turned * desired).sum(axis=1)
    return behind(ahead, motions.baseline @ desired, between, scale * rays.noise)


class Spread(NamedTuple):
    """
    Deviations of bearings, current and desired, and of the heading, (3,) each [rad].

    ``noise`` is what residuals make of them, ``camera`` what errors of the camera file do.
    ``tails`` is by how much squared residuals, as they sum up, are larger than those of normal
    noise of which each is independent.
    """

    noise: FloatArray
    camera: FloatArray
    tails: float

    @property
    def whole(self) -> FloatArray:
        """What both make together."""
        return np.hypot(self.noise, self.camera)


def spread_of(fit: GeneralFit, shared: float = 1.0) -> tuple[GeneralFit, Spread]:
    """
    Return the fit, better where looking around found something, and the spread of its best motion.

    Near the best motion the covariance tells it. Where the baseline hardly shows, costs are no
    parabola: all directions around are tried, each with its best rotation. ``shared`` is how many
    matches tell as much as an independent one.
    """
    around = _around(fit)
    costs = fit.losses(around).sum(axis=1)
    if costs.min() < fit.losses(fit.best).sum() - 0.5:  # of a match
        better = fit.motions.joined(around.take(costs.argsort()[:MODES]))
        fit = fit._replace(motions=better).settled()
        around = _around(fit)
    rows = fit.rows(fit.best)[0]
    weight = fit.weight(rows[0])
    information = Equations.of(rows * weight, RIDGE * np.eye(MOTION_PARAMETERS)).information
    inverse = np.asarray(np.linalg.inv(information))
    pulls = np.asarray(rows[1:] * rows[0] * weight**2)
    shown = float((inverse * (pulls @ pulls.T)).sum()) / (MOTION_PARAMETERS * fit.scale**2)
    parts = together(pulls, inverse, fit.rays.desired)
    count = max(int((weight > 0.0).sum()), MOTION_PARAMETERS + 1)
    tails = max(shown, 1.0) * max(shared, parts) * count / (count - MOTION_PARAMETERS)
    slopes = _bearing_slopes(fit.best)
    of_pixel = np.sqrt(np.diagonal(slopes @ inverse @ slopes.T))  # by residuals of 1 px
    noise = math.sqrt(tails) * fit.scale * of_pixel
    for motions, few in (around, 0.0), (fit.motions, FEW):
        noise = np.maximum(noise, _implied(motions, fit, tails, few))
    # Residuals of a size that conspire as far as they can: Cauchy and Schwarz.
    alike = SHARED_PX * min(LARGEST_PIXEL / float(fit.rays.mean_noise), 1.0) * math.sqrt(count)
    return fit, Spread(noise, alike * of_pixel, tails)


def _around(fit: GeneralFit) -> Motions:
    """Return motions with directions around the best one, their rotations refitted."""
    turn = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ fit.best.tangents[0]
    baseline = np.cos(RADII)[:, None, None] * fit.best.baseline
    baseline = (baseline + np.sin(RADII)[:, None, None] * ring).reshape(-1, 3)
    motions = Motions(np.repeat(fit.best.rotation, len(baseline), axis=0), baseline)
    return fit.refined(motions, np.array([3.0, 2.0, 1.0, 1.0]), unknowns=3)


def _implied(motions: Motions, fit: GeneralFit, tails: float, few: float) -> FloatArray:
    """
    Return the deviations, (3,), that other motions imply, by what they cost more than the best.

    The best reasons of ``few`` of the matches do not count: a wall is seen alike from two places,
    and a handful of matches off it tells them apart: if some of these are wrong, the wrong place.
    """
    reasons = np.sort(fit.losses(motions) - fit.losses(fit.best), axis=1)
    excess = reasons[:, : reasons.shape[1] - math.ceil(few * reasons.shape[1])].sum(axis=1)
    excess = np.maximum(excess, 0.0) / tails
    away = motions.bearings - fit.best.bearings
    away = np.abs(np.remainder(away + np.pi, 2.0 * np.pi) - np.pi)
    implied = away / np.sqrt(np.maximum(excess, 1.0))[:, None]
    return np.asarray(implied[excess < CONTRADICTING].max(axis=0, initial=0.0))


def _bearing_slopes(best: Motions) -> FloatArray:
    """Return the derivatives of bearings and heading of one motion by five parameters, (3, 5)."""
    step = 1e-6 * np.eye(5)
    repeated = Motions(*(np.repeat(part, 5, axis=0) for part in best))
    away = repeated.changed(step).bearings - repeated.changed(-step).bearings
    return np.asarray((np.remainder(away + np.pi, 2.0 * np.pi) - np.pi).T / 2e-6)
