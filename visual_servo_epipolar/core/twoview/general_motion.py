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
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix, MIN_MATCHES
from visual_servo_epipolar.core.geometry.least_squares import Equations, least_squares, TUKEY
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, headings
from visual_servo_epipolar.core.geometry.significance import together
from visual_servo_epipolar.core.tracking.robust_geometry import essential_matrices
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate
from visual_servo_epipolar.core.twoview.five_point import decomposed
from visual_servo_epipolar.core.twoview.hypotheses import (
    INLIER_DEVIATIONS,
    Rays,
    rays_of,
    WORST,
)
from visual_servo_epipolar.core.twoview.planar import DEPTH_DEVIATIONS
from visual_servo_epipolar.core.twoview.refinement import (
    LARGEST_STEP,
    linearised,
    RIDGE,
    squared_distances,
    table_of,
)
from visual_servo_epipolar.core.twoview.tilted_planar import JITTER_DEVIATIONS

WIDTHS = (4.0, 3.0, 2.0, 1.5, 1.2, 1.0)  # of the noise, step by step
LAST = (1.5, 1.2, 1.0, 1.0, 1.0, 1.0, 1.0)
FIRST_SCALE = 0.5  # from which on the noise is found [px]
LEAST_SCALE = 0.15  # noise [px] below which residuals are not believed
MODES, APART = 12, 0.01  # refined motions that are kept, and between them: of R, and of t [rad]
DIRECTIONS = 40  # of a baseline that hardly shows, to start from
MEDIAN = 0.6612  # of |x| of a normal x cut off at INLIER_DEVIATIONS
NEAR_EPIPOLE = 1e-3  # sine of the angle from it within which depths have no sign
AXES = cross_matrix(np.eye(3))  # of the three turns
RADII = np.radians([0.3, 0.7, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0])  # around the best direction
FEW = 0.05  # of the matches, on which alone no answer may hang
POSSIBLE = 13.8  # excess cost of what may still be true: 99.9 % of a direction by two angles
# Of a good calibration: principal point [px], focal length, radial distortion.
CENTRE_PX, FOCAL_RATIO, RADIAL = 2.5, 0.003, 0.004
# And of one view against the other: rows read one after the other, a focus that changed.
# A hand turns by 0.1 deg while a phone reads them: half a pixel from the centre to 20 deg aside.
ROWS_PX, FOCUS_RATIO, HALF_HEIGHT = 0.5, 0.0005, 0.35
TURNED = math.radians(2.0)  # less where it has not turned: what moves in a hand turns
# Of the images for which these pixels hold: larger ones are those of a sensor that was binned, or
# of an image that was reduced, and neither lens nor hand is worse [rad].
LARGEST_PIXEL = 1.0 / 400.0
ALIKE = 4.0  # matches that tell as much of these errors as one would, if its noise were its own


class Motions(NamedTuple):
    """Rotations current -> desired, shape (K, 3, 3), and unit baselines, (K, 3)."""

    rotation: FloatArray
    baseline: FloatArray

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


class Matched(NamedTuple):
    """The matches: rays with the angle of a pixel as noise, and the table of them."""

    rays: Rays
    table: FloatArray

    def squared(self, motions: Motions, scale: float) -> FloatArray:
        """Return squared distances in deviations, (K, N), infinite where depths are wrong."""
        squared = squared_distances(motions.essentials.reshape(-1, 9), self.table) / scale**2
        return np.where(wrong_depths(motions, self.rays, scale), np.inf, squared)

    def costs(self, motions: Motions, scale: float) -> FloatArray:
        """Return the sums of truncated squared distances in deviations, (K,)."""
        return np.asarray(np.minimum(self.squared(motions, scale), WORST).sum(axis=1))

    def rows(self, motions: Motions) -> FloatArray:
        """Return residuals [px] and their derivatives by five parameters, (K, 6, N)."""
        rotation, across = motions.rotation, cross_matrix(motions.baseline)
        stack = np.empty((len(rotation), 6, 3, 3))
        stack[:, 0] = across @ rotation
        stack[:, 1:4] = across[:, None] @ AXES @ rotation[:, None]
        stack[:, 4:] = cross_matrix(motions.tangents) @ rotation[:, None]
        rows, gradient = linearised(stack.reshape(-1, 6, 9), self.table)
        return np.asarray(rows / np.sqrt(gradient)[:, None])

    def refined(
        self, motions: Motions, widths: FloatArray, *, turns_only: bool = False
    ) -> Motions:
        """Return motions, or only their rotations, after steps at ``widths`` of the noise [px]."""

        def linearise(now: Motions, number: int) -> Equations:
            rows = self.rows(now)[:, : 4 if turns_only else 6]
            return Equations.of(rows * _weight(rows[:, 0], widths[number])[:, None], _ridge(rows))

        def moved(now: Motions, at: Equations, change: FloatArray) -> tuple[Motions, bool]:
            return now.changed(np.pad(-change, ((0, 0), (0, 5 - change.shape[1])))), False

        return least_squares(motions, linearise, moved, len(widths))[0]


def _weight(residual: FloatArray, scale: float) -> FloatArray:
    """Return the root of Tukey's weight at a noise of ``scale`` [px]."""
    return np.maximum(1.0 - (residual / (TUKEY * scale)) ** 2, 0.0)


def _ridge(rows: FloatArray) -> FloatArray:
    return np.asarray(RIDGE * np.eye(rows.shape[1] - 1))


class GeneralFit(NamedTuple):
    """
    Refined motions, the best first, of shape (K, ...), from N matches.

    ``costs``, (K,), are sums of truncated squared distances in deviations of ``scale`` [px], with
    the worst of each match whose depths have the wrong sign; ``inliers``, (N,), agree with the
    best.
    """

    motions: Motions
    costs: FloatArray
    inliers: BoolArray
    scale: float
    matched: Matched

    @property
    def best(self) -> Motions:
        """The best motion, of shape (1, ...)."""
        return self.motions.take(slice(1))

    def cost_of(self, essential: FloatArray) -> float:
        """Return the cost of E, shape (3, 3): of the better motion."""
        baseline, both = decomposed(essential[None])
        motions = _twins(Motions(both[0], baseline))
        return float(self.matched.costs(motions, self.scale).min())

    def plain_cost(self, essential: FloatArray) -> float:
        """Return the truncated cost of E, shape (3, 3), whatever depths say."""
        squared = squared_distances(essential.reshape(1, 9), self.matched.table) / self.scale**2
        return float(np.minimum(squared, WORST).sum())


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
    matched = Matched(rays, table_of(rays))
    motions = _different(matched, matched.refined(_starts(rays), np.array(WIDTHS)), 1.0)
    return _fit(matched, matched.refined(motions, FIRST_SCALE * np.array(LAST)), FIRST_SCALE)


def _fit(matched: Matched, motions: Motions, scale: float) -> GeneralFit:
    """Return the fit after more steps, at a ``scale`` that follows the best residuals."""
    for width in LAST:
        motions = matched.refined(motions, np.array([width * scale]))
        squared = matched.squared(motions, scale)
        best = np.minimum(squared, WORST).sum(axis=1).argmin()
        scale = scale_of(scale * np.sqrt(squared[best]), scale)
    motions = _different(matched, motions, scale)
    inliers = matched.squared(motions.take(slice(1)), scale)[0] <= WORST
    return GeneralFit(motions, matched.costs(motions, scale), inliers, scale, matched)


def _starts(rays: Rays) -> Motions:
    """Return motions by USAC, and of the best rotation with a baseline in any direction."""
    current, desired = _stacked(rays)
    k = np.arange(DIRECTIONS) + 0.5  # a spiral over half a sphere
    height, angle = k / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - height * height)
    baseline = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    rotation = fit_rotation(current, desired).rotation
    turned = Motions(np.repeat(rotation[None], DIRECTIONS, axis=0), baseline)
    essential = essential_matrices(current, desired, float(rays.mean_noise))
    if not len(essential):
        return turned
    baseline, both = decomposed(essential)
    return Motions(both[0], baseline).joined(turned)


def _stacked(rays: Rays) -> tuple[FloatArray, FloatArray]:
    """Return current and desired rays, shape (N, 3) each."""
    return np.stack(rays[:3], axis=-1), np.stack(rays[3:6], axis=-1)


def _different(matched: Matched, motions: Motions, scale: float) -> Motions:
    """Return different motions, MODES at most, each with the better twin, the best first."""
    motions = _twins(motions)
    costs = matched.costs(motions, scale)
    both = np.concatenate([motions.rotation.reshape(-1, 9), motions.baseline], axis=1)
    chosen: list[int] = []
    for place in costs.argsort(kind='stable').tolist():
        if len(chosen) < MODES and (np.abs(both[chosen] - both[place]).max(axis=1) > APART).all():
            chosen.append(place)
    return motions.take(chosen)


def _twins(motions: Motions) -> Motions:
    """Return all motions of the same E: t or -t, R or R turned by half around t; (4 K, ...)."""
    rotation, baseline = motions
    half = 2.0 * baseline[:, :, None] * baseline[:, None] - np.eye(3)
    both = np.concatenate([rotation, half @ rotation])
    return Motions(
        np.tile(both, (2, 1, 1)), np.concatenate([baseline, baseline, -baseline, -baseline])
    )


def scale_of(distances: FloatArray, scale: float) -> float:
    """Return the noise [px] of ``distances``, (N,), of which many are no noise: from ``scale``."""
    for _ in range(4):
        within = distances[distances <= INLIER_DEVIATIONS * scale]
        if len(within) <= 5:
            break
        spare = len(within) / (len(within) - 5)
        scale = max(float(np.median(within)) / MEDIAN * spare**0.5, LEAST_SCALE)
    return scale


def wrong_depths(motions: Motions, rays: Rays, scale: float) -> BoolArray:
    """
    Return which matches, shape (K, N), lie behind a camera by more than noise.

    A match moves along its epipolar line from where it would be at infinity. The other way there
    is nothing. Unit rays have depths along them, behind the camera as well.
    """
    current, desired = (each.T for each in _stacked(rays))
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


class Spread(NamedTuple):
    """
    Deviations of bearings, current and desired, and of the heading, (3,) each [rad].

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
    around, costs = _around(fit)
    if costs.min() < fit.costs[0] - 0.5:  # of a match
        found = fit.motions.joined(around.take(costs.argsort()[: MODES // 2]))
        fit = _fit(fit.matched, found, fit.scale)
        around, costs = _around(fit)
    rows = fit.matched.rows(fit.best)[0]
    weight = _weight(rows[0], fit.scale)
    changes = _camera_changes(fit, rows[0])
    better, left = _beside_camera(fit, rows, weight, changes)
    pulls = np.asarray(rows[1:] * weight**2)
    information = Equations.of(rows * weight, _ridge(rows[None])).information
    inverse = np.asarray(np.linalg.inv(information))
    rays = fit.matched.rays
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d], axis=1)
    parts = together(pulls * left, inverse, desired)
    meat = (pulls * rows[0]) @ (pulls * rows[0]).T
    count = max(int((weight > 0.0).sum()), 6)
    spare = max(shared, parts) * count / (count - 5)
    tails = max(float(np.trace(inverse @ meat)) / (5 * fit.scale**2), 1.0) * spare
    covariance = inverse @ (0.5 * spare * (meat + fit.scale**2 * information)) @ inverse
    slopes = _bearing_slopes(fit.best)
    noise = np.sqrt(np.diagonal(slopes @ covariance @ slopes.T))
    excess = np.concatenate([costs - fit.costs[0], _lasting_excess(fit)])
    noise = np.maximum(noise, _implied(around.joined(fit.motions), excess, fit, tails))
    camera = np.sqrt(np.square(slopes @ inverse @ pulls @ changes.T).sum(axis=-1))
    return better, Spread(noise, camera, tails)


def _around(fit: GeneralFit) -> tuple[Motions, FloatArray]:
    """Return motions with directions around the best one, their rotations refitted; costs."""
    turn = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ fit.best.tangents[0]
    baseline = np.cos(RADII)[:, None, None] * fit.best.baseline
    baseline = (baseline + np.sin(RADII)[:, None, None] * ring).reshape(-1, 3)
    motions = Motions(np.repeat(fit.best.rotation, len(baseline), axis=0), baseline)
    widths = fit.scale * np.array([3.0, 2.0, 1.0, 1.0])
    motions = fit.matched.refined(motions, widths, turns_only=True)
    return motions, fit.matched.costs(motions, fit.scale)


def _lasting_excess(fit: GeneralFit) -> FloatArray:
    """
    Return by how much each motion, (K,), costs more than the best, without its FEW best reasons.

    A wall is seen alike from two places, and a handful of matches off it tells them apart: if some
    of these are wrong, the wrong place.
    """
    losses = np.minimum(fit.matched.squared(fit.motions, fit.scale), WORST)
    reasons = np.sort(losses - losses[0], axis=1)
    return np.asarray(reasons[:, : -math.ceil(FEW * losses.shape[1])].sum(axis=1))


def _implied(motions: Motions, excess: FloatArray, fit: GeneralFit, tails: float) -> FloatArray:
    """Return the deviations, (3,), that motions imply whose costs are in ``excess``, (K,)."""
    away = motions.bearings - fit.best.bearings
    away = np.abs(np.remainder(away + np.pi, 2.0 * np.pi) - np.pi)
    excess = np.maximum(excess, 0.0) / tails
    implied = away / np.sqrt(np.maximum(excess, 1.0))[:, None]
    return np.asarray(implied[excess < POSSIBLE].max(axis=0, initial=0.0))


def _camera_changes(fit: GeneralFit, residual: FloatArray) -> FloatArray:
    """Return how residuals, (7, N), change, were the camera wrong by one deviation in one way."""
    rays = fit.matched.rays
    current, desired = (each.T for each in _stacked(rays))
    cosine = 0.5 * (float(np.trace(fit.best.rotation[0])) - 1.0)
    hand = min(max(math.acos(min(max(cosine, -1.0), 1.0)) / TURNED, 0.25), 1.0)
    others = [*_wrong_rays(desired, rays.noise_d)[:4], desired, desired, desired]
    changes, pixel = [], np.stack([rays.noise_a, rays.noise_d], axis=-1)
    for mine, other in zip(_wrong_rays(current, rays.noise_a), others, strict=True):
        wrong = Matched(rays, table_of(rays_of(mine.T, other.T, pixel)))
        changes.append(wrong.rows(fit.best)[0, 0] - residual)
    return np.asarray(np.array(changes) * np.array([1.0] * 4 + [hand] * 3)[:, None])


def _wrong_rays(ray: FloatArray, pixel: FloatArray) -> list[FloatArray]:
    """
    Return rays, (3, N), with errors that both views share, and that one has against the other.

    Those are of the centre, aside and down, of focal length and distortion; these of rows that are
    read late, aside and down, and of the focus.
    """
    x, y, z = ray
    pixel, across = np.minimum(pixel, LARGEST_PIXEL), np.sqrt(x * x + y * y)
    tangent = np.minimum(across / np.maximum(np.abs(z), 0.1), 1.5)
    outward = np.stack([x * z, y * z, -across * across]) / np.maximum(across, 1e-9)
    aside, down = np.eye(3)[:2, :, None]
    rows = ROWS_PX / HALF_HEIGHT * y
    return [
        normalised((ray + move).T).T
        for move in (
            aside * CENTRE_PX * pixel,
            down * CENTRE_PX * pixel,
            FOCAL_RATIO * across * np.abs(z) * outward,
            RADIAL * tangent**3 / (1.0 + tangent**2) * outward,
            aside * rows * pixel,
            down * rows * pixel,
            FOCUS_RATIO * across * np.abs(z) * outward,
        )
    ]


def _beside_camera(
    fit: GeneralFit, rows: FloatArray, weight: FloatArray, changes: FloatArray
) -> tuple[GeneralFit, FloatArray]:
    """
    Return the fit with its best motion estimated together with errors of the camera, before all.

    And the residuals, (N,), that these leave.

    These have a prior of one deviation each; many matches tell the part of them that no motion
    makes, as if there were fewer: neighbours err alike. Which matches are right is settled before:
    else errors bend until look-alikes fit. The deviation stays what it was, as rows read late move
    what is near more.
    """
    both = np.concatenate([rows, changes])
    prior = np.diag([RIDGE] * 5 + [ALIKE * fit.scale**2] * len(changes))
    change = -Equations.of(both * weight, prior).change()
    motions = fit.best.changed(change[None, :5]).joined(fit.motions)
    return fit._replace(motions=motions, costs=np.append(fit.costs[0], fit.costs)), rows[
        0
    ] + change @ both[1:]


def _bearing_slopes(best: Motions) -> FloatArray:
    """Return the derivatives of bearings and heading of one motion by five parameters, (3, 5)."""
    step = 1e-6 * np.eye(5)
    repeated = Motions(*(np.repeat(part, 5, axis=0) for part in best))
    away = repeated.changed(step).bearings - repeated.changed(-step).bearings
    return np.asarray((np.remainder(away + np.pi, 2.0 * np.pi) - np.pi).T / 2e-6)


def planar_is_simplest(planar: Estimate, fit: GeneralFit, spread: Spread, mount: Attitude) -> bool:
    """
    Return whether a ``planar`` motion explains the matches as well as the best general one.

    By minimum description length: it has a parameter less, which is worth log(N) of the robust
    cost (Torr's GRIC weighs costs the same way). Costs are at the scale of the residuals, less
    what their tails add: by shares of inliers, each attitude that bends far enough would do.
    """
    excess = (fit.cost_of(planar.fundamental) - float(fit.costs[0])) / spread.tails
    excess += (planar.jump / (JITTER_DEVIATIONS * mount.jitter)) ** 2 if mount.jitter else 0.0
    if planar.attitude is not None:
        excess += ((planar.attitude.tilt - mount.tilt) / mount.tilt_deviation) ** 2
        excess += ((planar.attitude.roll - mount.roll) / mount.roll_deviation) ** 2
    return excess <= math.log(fit.matched.rays.matches)


def planar_deviations(planar: Estimate, spread: Spread) -> FloatArray:
    """
    Return the deviations of a planar motion, (3,) [rad]: current, desired, heading.

    A level plane is as far from that of motion as tilt and roll are unknown: to second order that
    turns bearings between the axis and across it. Its covariance is that of normal noise and of
    the mount; what noise has beyond the normal is in the ``spread``.
    """
    covariance = planar.whole_covariance
    psi, phi = covariance[0, 0], covariance[1, 1]
    variances = np.array([phi, psi, max(psi + phi - 2.0 * covariance[0, 1], 0.0)])
    variances += (1.0 - 1.0 / spread.tails) * spread.noise**2 + spread.camera**2
    if planar.attitude is not None:
        lean = planar.attitude.tilt_deviation**2 + planar.attitude.roll_deviation**2
        bearings = np.array([planar.bearings.current, planar.bearings.desired])
        variances[:2] += (0.5 * lean * np.sin(2.0 * bearings)) ** 2
    return np.asarray(np.sqrt(variances))
