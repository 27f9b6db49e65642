"""
Extrinsics: the mount of the camera on the base, estimated from commands and bearings.

The camera is dead-reckoned from the commanded speed and the measured heading, in axes of the
goal's camera (x right, y forward), and held against the direction psi in which it is seen. That
tells how far off the goal is, where a robot goes that drives straight on (yaw), and how a turn in
place moves its camera (the lever arm). A Kalman filter in modified polar coordinates, which bears
a distance that is not known (Aidala, Hammel 1983): psi [rad], the logarithm of the distance [m],
yaw [rad], and the lever arm forward and left [m], in axes of the camera.
"""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing

PSI, RHO, YAW, FORWARD, LEFT = range(5)
IDENTITY = np.eye(5)
NEAREST = 0.02  # [m]
FIRST_DISTANCE, FIRST_DEVIATION = 3.0, 1.0  # [m], of the logarithm: one to eight metres
LENS = 0.02  # of a turn of a radian, that two views may show wrong: the lens is not known to them
YAW_WALK = math.radians(1.0)  # of the yaw, as bases crab and models err [rad], in a metre
SLIP = 0.05  # of a travel: what dead reckoning is wrong by
CORRELATION = 6.0  # bearings share the photograph: so many tell as much as one
LEAST_DEVIATION = 2e-3  # of a bearing: what tilt and roll are not known to [rad]
REMEMBERED = 0.1  # least deviation of the logarithm of a distance by a memory of views
CONTRADICTED = 4.0  # deviations off that, beyond which the distance of before counts no more
# Change of the logarithm of a distance: that beyond which an update is iterated; at the end of
# that, and of one step at most.
LINEAR, CONVERGED, LONGEST_STEP, MOST_ITERATIONS = 0.1, 0.02, 0.7, 8
# Deviation of the logarithm of a distance that is known: at first, and after a missed attempt.
RANGED = (0.25, 0.5)
MAX_CONTRADICTIONS = 12  # beyond which bearings contradict what was driven


@dataclass(frozen=True, eq=False)
class Extrinsics:
    """
    Mean, shape (5,), and covariance, (5, 5), of the place of the camera and of its mount.

    ``configured``, shape (3,), is the mount by the parameters: yaw [rad], and the lever arm
    forward and left [m], turned into axes of the camera; ``deviations``, shape (3,), are theirs.
    ``heading`` error [rad] and ``travel`` [m] are those of the last update and since. ``placed``
    says whether there was any, ``believed`` whether the learnt mount differs from that;
    ``contradictions`` counts bearings that commands do not explain, less those that they do;
    ``remembers`` says whether the bearings are those of a memory of views.
    """

    configured: FloatArray
    deviations: FloatArray
    mean: FloatArray
    covariance: FloatArray
    heading: float = 0.0
    travel: float = 0.0
    placed: bool = False
    believed: bool = False
    contradictions: int = 0
    remembers: bool = False

    @property
    def mount(self) -> FloatArray:
        """Yaw [rad], offset forward and left [m] that control goes by, shape (3,)."""
        return self.mean[YAW:] if self.believed else self.configured

    @property
    def likely(self) -> FloatArray:
        """The likeliest mount, shape (3,), believed or not: the configured one may be a guess."""
        return self.mean[YAW:]

    @property
    def lever_deviation(self) -> float:
        """Deviation of how far the camera is ahead of the axle [m]."""
        return math.sqrt(self.covariance[FORWARD, FORWARD])

    @property
    def contradicts(self) -> bool:
        """Whether the bearings contradict what was driven."""
        return self.contradictions > MAX_CONTRADICTIONS

    @property
    def is_ranged(self) -> bool:
        """Whether the distance is known, to a fourth or so."""
        return bool(self.covariance[RHO, RHO] < RANGED[0] ** 2)

    @property
    def distance(self) -> float:
        """Distance of the camera from that of the goal [m]."""
        return math.exp(self.mean[RHO])


def configured_extrinsics(configured: FloatArray, deviations: FloatArray) -> Extrinsics:
    """Return what is known beforehand: mount and deviations, (3,) each, in base axes."""
    yaw, forward, left = configured.tolist()
    cosine, sine = math.cos(yaw), math.sin(yaw)
    configured = np.array([yaw, cosine * forward + sine * left, cosine * left - sine * forward])
    return unplaced(configured, deviations)


def unplaced(configured: FloatArray, deviations: FloatArray) -> Extrinsics:
    """Return a belief that has seen nothing, of a mount in axes of the camera, (3,) each."""
    return Extrinsics(
        configured,
        deviations,
        np.concatenate([[0.0, math.log(FIRST_DISTANCE)], configured]),
        np.diag(np.concatenate([[1.0, FIRST_DEVIATION**2], deviations**2])),
    )


class PathPrediction(NamedTuple):
    """Place after a drive: ``mean``, (5,), its ``transition``, (5, 5), and distance squared."""

    mean: FloatArray
    transition: FloatArray
    square: float

    def from_mean(self, mean: FloatArray, at: FloatArray) -> FloatArray:
        """Return where the drive leads from ``mean``, (5,), as linear about ``at``, (5,)."""
        return self.mean if mean is at else self.mean + self.transition @ (mean - at)


def predict_path(mean: FloatArray, headings: tuple[float, float], travel: float) -> PathPrediction:
    """Return the place after a ``travel`` [m] from the first of two ``headings`` to the second."""
    psi, rho, yaw, *lever = mean.tolist()
    before, after = headings
    distance = math.exp(rho)
    middle = before + 0.5 * math.remainder(after - before, 2.0 * math.pi)
    right, ahead = -travel * math.sin(middle - yaw), travel * math.cos(middle - yaw)
    swing = camera_swing(before, after)
    by_forward, by_left = (swing @ lever).tolist()
    x, y = distance * math.cos(psi), distance * math.sin(psi)
    new_x, new_y = right + by_forward + x, ahead + by_left + y
    square = max(new_x * new_x + new_y * new_y, NEAREST**2)
    (right_f, right_l), (ahead_f, ahead_l) = swing.tolist()
    # derivatives of the new place by the unknowns
    by_place = np.array([[-y, x, ahead, right_f, right_l], [x, y, -right, ahead_f, ahead_l]])
    east, north = new_x / square, new_y / square
    transition = IDENTITY.copy()
    transition[:2] = np.array([[-north, east], [east, north]]) @ by_place
    moved = mean.copy()
    turn = math.remainder(math.atan2(new_y, new_x) - psi, 2.0 * math.pi)
    moved[:2] = psi + turn, 0.5 * math.log(square)
    return PathPrediction(moved, transition, square)


def placed(before: Extrinsics, bearings: Bearings, deviation: float) -> Extrinsics:
    """Return the belief with the camera seen anew along psi [rad], at any distance."""
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[PSI] = bearings.psi  # the distance is the last one, or that of configured_extrinsics
    covariance[:2] = covariance[:, :2] = 0.0
    covariance[PSI, PSI], covariance[RHO, RHO] = deviation**2, FIRST_DEVIATION**2
    return replace(
        before,
        mean=mean,
        covariance=covariance,
        heading=bearings.heading_error,
        travel=0.0,
        placed=True,
    )


def moved(before: Extrinsics, heading: float, *, at: FloatArray | None = None) -> Extrinsics:
    """Return the belief after its ``travel`` to a ``heading`` error [rad], linear about ``at``."""
    at = before.mean if at is None else at
    path = predict_path(at, (before.heading, heading), before.travel)
    covariance = path.transition @ before.covariance @ path.transition.T
    slipped = (SLIP * before.travel) ** 2 / path.square
    covariance[PSI, PSI] += slipped
    covariance[RHO, RHO] += slipped
    covariance[YAW, YAW] += YAW_WALK * YAW_WALK * abs(before.travel)
    if not before.remembers:
        turn = math.remainder(heading - before.heading, 2.0 * math.pi)
        covariance[PSI, PSI] += LENS * LENS * abs(turn)
    mean = path.from_mean(before.mean, at)
    return replace(before, mean=mean, covariance=covariance, heading=heading, travel=0.0)


def moved_to(before: Extrinsics, heading: float, psi: float, deviation: float) -> Extrinsics:
    """
    Return the belief after its ``travel``, linear about where ``psi`` [rad] has the camera.

    A distance of which a factor e is unknown turns psi by too much for one tangent: what a
    bearing tells is overrated, and the mount pays for it. Hence the update is iterated, Gauss and
    Newton's way, before it is done (Bell and Cathey 1993).
    """
    at = before.mean
    for _ in range(MOST_ITERATIONS):
        ahead = moved(before, heading, at=at)
        spread = float(ahead.covariance[PSI, PSI]) + CORRELATION * deviation * deviation
        innovation = math.remainder(psi - ahead.mean[PSI], 2.0 * math.pi)
        transition = predict_path(at, (before.heading, heading), before.travel).transition
        step = before.mean + before.covariance @ transition[PSI] * (innovation / spread) - at
        if abs(step[RHO]) < CONVERGED:
            break
        at = at + step * min(LONGEST_STEP / abs(step[RHO]), 1.0)
    return moved(before, heading, at=at)


def seen(before: Extrinsics, psi: float, deviation: float) -> tuple[Extrinsics, float]:
    """Return the belief after ``psi`` [rad] is seen, and the innovation in deviations."""
    innovation = math.remainder(psi - before.mean[PSI], 2.0 * math.pi)
    noise = CORRELATION * deviation * deviation
    spread = math.sqrt(float(before.covariance[PSI, PSI]) + noise)
    return corrected(before, PSI, innovation, noise), innovation / spread


def seen_anew(before: Extrinsics, psi: float, deviation: float) -> tuple[Extrinsics, float]:
    """Return the belief with ``psi`` [rad] in place of the predicted one, and the innovation."""
    noise = CORRELATION * deviation * deviation + LENS * LENS
    innovation = math.remainder(psi - before.mean[PSI], 2.0 * math.pi)
    innovation /= math.sqrt(float(before.covariance[PSI, PSI]) + noise)
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[PSI] = psi
    covariance[PSI] = covariance[:, PSI] = 0.0
    covariance[PSI, PSI] = CORRELATION * deviation * deviation
    return replace(before, mean=mean, covariance=covariance), innovation


def corrected(before: Extrinsics, of: int, innovation: float, noise: float) -> Extrinsics:
    """Return the belief after one of its states was measured, with variance ``noise`` (Kalman)."""
    column = before.covariance[:, of]
    gain = column / (float(column[of]) + noise)
    return replace(
        before,
        mean=before.mean + gain * innovation,
        covariance=before.covariance - gain[:, None] * column,
    )


def is_linear(belief: Extrinsics, psi: float, deviation: float) -> bool:
    """Return whether ``psi`` [rad] leaves the distance so much alike that one update will do."""
    after, _ = seen(belief, psi, deviation)
    return bool(abs(after.mean[RHO] - belief.mean[RHO]) <= LINEAR)


def ranged(before: Extrinsics, distance: float, deviation: float) -> Extrinsics:
    """
    Return the belief after a memory of views gave the ``distance`` [m], by what was driven.

    All that it tells has one scale, and hence one error: the next view of it adds nothing to what
    the belief has of it already, and a distance that contradicts it is dropped.
    """
    distance = max(distance, NEAREST)
    innovation = math.log(distance) - before.mean[RHO]
    variance, known = max(REMEMBERED, deviation / distance) ** 2, before.covariance[RHO, RHO]
    if abs(innovation) > CONTRADICTED * math.sqrt(variance + known):
        mean, covariance = before.mean.copy(), before.covariance.copy()
        mean[RHO] = math.log(distance)
        covariance[RHO] = covariance[:, RHO] = 0.0
        covariance[RHO, RHO] = variance
        return replace(before, mean=mean, covariance=covariance)
    if known <= variance:
        return before
    return corrected(before, RHO, innovation, variance * known / (known - variance))
