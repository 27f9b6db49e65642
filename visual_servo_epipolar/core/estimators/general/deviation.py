"""
Deviation of the bearings of a general motion: of noise as residuals show it, and of the camera.

The covariance is a sandwich: residuals with their own tails, not those of a model, and as they
err together in parts of the image. Errors of the camera file move all residuals, and no
number of matches averages them out.
"""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate
from visual_servo_epipolar.core.estimators.general.motion import (
    AXES,
    changed,
    cost_of_essential,
    costs_of,
    GeneralFit,
    GeneralStep,
    improved,
    losses_of,
    Motions,
    RIDGE,
    step,
    turned_only,
    UNKNOWNS,
)
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays
from visual_servo_epipolar.core.estimators.machinery.sampson import table_of
from visual_servo_epipolar.core.estimators.machinery.tilted_planar import JITTER_DEVIATIONS
from visual_servo_epipolar.core.geometry.least_squares import Equations
from visual_servo_epipolar.core.geometry.rotation import headings

RADII = np.radians([0.3, 0.7, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0])  # around the best direction
AZIMUTHS = 8
REFITS = (3.0, 2.0, 1.0, 1.0)  # noises of the steps of their rotations
ROUNDS, RETRIED, NO_BETTER = 3, 6, 0.5  # improvements that are tried; excess that is none
FEW = 0.05  # of the matches, on which alone no answer may hang
POSSIBLE = 13.8  # excess cost of what may still be true: 99.9 % of a direction by two angles
# Of a good calibration: principal point [px], focal length, radial distortion.
CENTRE_PX, FOCAL_RATIO, RADIAL = 2.5, 0.003, 0.004
# And of one view against the other: rows read one after the other, a focus that changed.
# A hand turns by 0.1 deg while a phone reads them: half a pixel from the centre to 20 deg aside.
ROWS_PX, FOCUS_RATIO = 0.5, 0.0005
# Less where it has not turned: what moves in a hand turns.
TURNED, LEAST_HAND = math.radians(2.0), 0.25
HALF_HEIGHT = 0.35  # sine of the angle off the axis at which those pixels are seen
# Of the images for which these pixels hold: larger ones are those of a sensor that was binned, or
# of an image that was reduced, and neither lens nor hand is worse [rad].
LARGEST_PIXEL = 1.0 / 400.0
PARTS = 4, 2  # of the image, across and down, in each of which residuals may err together
RAY_PARTS = ('x_a', 'y_a', 'z_a', 'x_d', 'y_d', 'z_d')
COMMON = 4  # kinds of errors that both views share
ALIKE = 4.0  # matches that tell as much of these errors as one would, if its noise were its own
FARTHEST = 1.5  # tangent of the angle off the axis to which that distortion is followed


def bearings_of(motion: Motions) -> FloatArray:
    """Return bearings, current and desired, and heading [rad] of motions: shape (K, 3)."""
    rotation, centre = motion
    goal = -(centre[:, None] @ rotation)[:, 0]
    return np.stack(
        [
            np.arctan2(goal[:, 0], goal[:, 2]),
            np.arctan2(centre[:, 0], centre[:, 2]),
            headings(rotation),
        ],
        axis=-1,
    )


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


def spread_of(fit: GeneralFit, rays: Rays, shared: float = 1.0) -> tuple[GeneralFit, Spread]:
    """
    Return the fit, better where looking around found something, and the spread of its best motion.

    Near the best motion the covariance tells it. Where the baseline hardly shows, costs are no
    parabola: all directions around are tried, each with its best rotation. ``shared`` is how many
    matches tell as much as an independent one.
    """
    for _ in range(ROUNDS):
        around, costs = _around(fit, rays)
        if costs.min() >= fit.costs[0] - NO_BETTER:
            break
        fit = improved(fit, around.take(costs.argsort()[:RETRIED]), rays)
    last = step(fit.motions.take(slice(1)), fit.table, fit.scale)
    changes = _camera_changes(last, fit, rays)
    better, left = _beside_camera(fit, last, changes)
    inverse = np.linalg.inv(last.information)[0]
    pulls = (last.slopes * (last.weight * last.residual)[:, None])[0]
    meat = pulls @ pulls.T
    count = max(int((last.weight > 0.0).sum()), UNKNOWNS + 1)
    together = _together(last.slopes[0] * (last.weight[0] * left), inverse, rays)
    spare = max(shared, together) * count / (count - UNKNOWNS)
    tails = max(float(np.trace(inverse @ meat)) / (UNKNOWNS * fit.scale**2), 1.0) * spare
    covariance = inverse @ (0.5 * spare * (meat + fit.scale**2 * last.information[0])) @ inverse
    slopes = _slopes(fit.motions.take(slice(1)), last.tangents)[0]
    noise = np.sqrt(np.diagonal(slopes @ covariance @ slopes.T))
    motions = Motions(*(np.concatenate(p) for p in zip(around, fit.motions, strict=True)))
    excess = np.concatenate([costs - fit.costs[0], _lasting_excess(fit, rays)])
    noise = np.maximum(noise, _implied(motions, excess, fit, tails))
    shifts = inverse @ (last.slopes[0] * last.weight[0]) @ changes.T
    camera = np.sqrt(np.square(slopes @ shifts).sum(axis=-1))
    return better, Spread(noise, camera, tails)


def _together(pulls: FloatArray, inverse: FloatArray, rays: Rays) -> float:
    """
    Return how much larger the variance is than if each residual had its own, at least 1.

    What moves, a shutter or a look-alike moves all matches of a part of the image: their
    ``pulls``, (5, N), then add up within parts, more than by chance.
    """
    rank = np.arctan2(rays.x_d, rays.z_d).argsort().argsort()
    across = rank * PARTS[0] // rays.matches
    part = across * PARTS[1] + (rays.y_d > np.median(rays.y_d))
    sums = pulls @ (part[:, None] == np.arange(PARTS[0] * PARTS[1]))
    each, whole = ((inverse * (of @ of.T)).sum() for of in (pulls, sums))
    return max(float(whole / each), 1.0)


def _lasting_excess(fit: GeneralFit, rays: Rays) -> FloatArray:
    """
    Return by how much each motion, (K,), costs more than the best, without its FEW best reasons.

    A wall is seen alike from two places, and a handful of matches off it tells them apart: if some
    of these are wrong, the wrong place.
    """
    losses = losses_of(fit, rays)
    reasons = np.sort(losses - losses[0], axis=1)
    return np.asarray(reasons[:, : -math.ceil(FEW * losses.shape[1])].sum(axis=1))


def _hand(rotation: FloatArray) -> float:
    """Return how much a camera with this ``rotation``, (3, 3), between the views was moving."""
    cosine = 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = float(np.arccos(min(max(cosine, -1.0), 1.0)))
    return float(min(max(angle / TURNED, LEAST_HAND), 1.0))


def _implied(motions: Motions, excess: FloatArray, fit: GeneralFit, tails: float) -> FloatArray:
    """Return the deviations, (3,), that motions imply whose costs are in ``excess``, (K,)."""
    away = bearings_of(motions) - bearings_of(fit.motions.take(slice(1)))
    away = np.abs(np.remainder(away + np.pi, 2.0 * np.pi) - np.pi)
    excess = np.maximum(excess, 0.0) / tails
    implied = away / np.sqrt(np.maximum(excess, 1.0))[:, None]
    return np.asarray(implied[excess < POSSIBLE].max(axis=0, initial=0.0))


def _around(fit: GeneralFit, rays: Rays) -> tuple[Motions, FloatArray]:
    """Return motions with directions around the best one, their rotations refitted; costs."""
    best = fit.motions.take(slice(1))
    tangents = step(best, fit.table, fit.scale).tangents[0]
    turn = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    ring = np.cos(turn)[:, None] * tangents[0] + np.sin(turn)[:, None] * tangents[1]
    baseline = (
        np.cos(RADII)[:, None, None] * best.baseline + np.sin(RADII)[:, None, None] * ring
    ).reshape(-1, 3)
    motions = Motions(np.repeat(best.rotation, len(baseline), axis=0), baseline)
    for width in REFITS:
        motions = turned_only(motions, fit.table, width * fit.scale)
    return motions, costs_of(motions, rays, fit.table, fit.scale)


def _camera_changes(last: GeneralStep, fit: GeneralFit, rays: Rays) -> FloatArray:
    """Return how residuals, (C, N), change, were the camera wrong by one deviation in one way."""
    best = fit.motions.take(slice(1))
    changes = np.stack(
        [step(best, moved, fit.scale).residual[0] for moved in _wrong_cameras(rays)]
    )
    changes -= last.residual[0]
    changes[COMMON:] *= _hand(best.rotation[0])
    return changes


def _beside_camera(
    fit: GeneralFit, last: GeneralStep, changes: FloatArray
) -> tuple[GeneralFit, FloatArray]:
    """
    Return the fit with its best motion, before all, estimated together with errors of the camera.

    And the residuals, (N,), that these leave.

    These have a prior of one deviation each; many matches tell the part of them that no motion
    makes, as if there were fewer: neighbours err alike. Which matches are right is settled before:
    else errors bend until look-alikes fit. The deviation stays what it was, as rows read late move
    what is near more.
    """
    slopes = np.concatenate([last.slopes[0], changes])
    prior = np.diag(np.r_[np.full(UNKNOWNS, RIDGE), np.full(len(changes), ALIKE * fit.scale**2)])
    rows = np.concatenate([last.residual, slopes]) * np.sqrt(last.weight)
    change = -Equations.of(rows, prior).change()
    best = changed(fit.motions.take(slice(1)), last.tangents, change[None, :UNKNOWNS])
    better = fit._replace(
        motions=Motions(*map(np.concatenate, zip(best, fit.motions, strict=True))),
        costs=np.concatenate([fit.costs[:1], fit.costs]),
        inliers=np.concatenate([fit.inliers[:1], fit.inliers]),
    )
    return better, last.residual[0] + change @ slopes


def _wrong_cameras(rays: Rays) -> list[FloatArray]:
    """Return tables of the matches, were the camera wrong by one deviation in one way."""
    current = np.stack([rays.x_a, rays.y_a, rays.z_a])
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d])
    tables = []
    for kind in range(COMMON + 3):
        moved = _moved(current, rays.noise_a, kind)
        other = _moved(desired, rays.noise_d, kind) if kind < COMMON else desired
        parts = dict(zip(RAY_PARTS, [*moved, *other], strict=True))
        tables.append(table_of(rays._replace(**parts)))
    return tables


def _moved(ray: FloatArray, pixel: FloatArray, kind: int) -> FloatArray:
    """Return rays, (3, N), by a principal point aside, down, a focal length or a distortion."""
    across, pixel = np.sqrt(ray[0] ** 2 + ray[1] ** 2), np.minimum(pixel, LARGEST_PIXEL)
    if kind in (0, 1, COMMON, COMMON + 1):
        direction = np.zeros(3)
        direction[kind % COMMON] = 1.0
        size = CENTRE_PX if kind < COMMON else ROWS_PX / HALF_HEIGHT * ray[1]
        move = direction[:, None] * (size * pixel)
    else:
        tangent = np.minimum(across / np.maximum(np.abs(ray[2]), 0.1), FARTHEST)
        angle = (FOCAL_RATIO if kind < COMMON else FOCUS_RATIO) * across * np.abs(ray[2])
        if kind == 3:
            angle = RADIAL * tangent**3 / (1.0 + tangent**2)
        outward = np.stack([ray[0] * ray[2], ray[1] * ray[2], -(across**2)])
        move = angle * outward / np.maximum(across, 1e-9)
    moved = ray + move
    return np.asarray(moved / np.sqrt((moved * moved).sum(axis=0)))


def _slopes(motions: Motions, tangents: FloatArray) -> FloatArray:
    """Return the derivatives of bearings and heading by the five parameters, (K, 3, 5)."""
    rotation, centre = motions
    goal = -(centre[:, None] @ rotation)[:, 0]
    slopes = np.zeros((len(centre), 3, UNKNOWNS))
    turned = AXES @ rotation[:, None]  # dR of the three turns, (K, 3, 3, 3)
    goal_by_turn = -(centre[:, None, None] @ turned)[:, :, 0]
    goal_by_way = -tangents @ rotation
    by_goal = np.concatenate([goal_by_turn, goal_by_way], axis=1)
    slopes[:, 0] = _by_angle(goal[:, None], by_goal)
    slopes[:, 1, 3:] = _by_angle(centre[:, None], tangents)
    x, y = rotation[:, 0, 0] + rotation[:, 2, 2], rotation[:, 2, 0] - rotation[:, 0, 2]
    dx, dy = turned[..., 0, 0] + turned[..., 2, 2], turned[..., 2, 0] - turned[..., 0, 2]
    slopes[:, 2, :3] = (x[:, None] * dy - y[:, None] * dx) / (x * x + y * y)[:, None]
    return slopes


def _by_angle(vector: FloatArray, change: FloatArray) -> FloatArray:
    """Return how atan2(x, z) of a vector changes, per change of it: shape (K, M)."""
    x, z = vector[..., 0], vector[..., 2]
    return np.asarray((z * change[..., 0] - x * change[..., 2]) / (x * x + z * z + 1e-12))


def planar_is_simplest(
    planar: Estimate, fit: GeneralFit, spread: Spread, rays: Rays, mount: Attitude
) -> bool:
    """
    Return whether a ``planar`` motion explains the matches as well as the best general one.

    By minimum description length: it has a parameter less, which is worth log(N) of the robust
    cost (Torr's GRIC weighs costs the same way). Costs are at the scale of the residuals, less
    what their tails add: by shares of inliers, each attitude that bends far enough would do.
    """
    excess = (
        cost_of_essential(planar.fundamental, fit, rays) - float(fit.costs[0])
    ) / spread.tails
    excess += (planar.jump / (JITTER_DEVIATIONS * mount.jitter)) ** 2 if mount.jitter else 0.0
    if planar.attitude is not None:
        excess += ((planar.attitude.tilt - mount.tilt) / mount.tilt_deviation) ** 2
        excess += ((planar.attitude.roll - mount.roll) / mount.roll_deviation) ** 2
    return excess <= math.log(rays.matches)


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
