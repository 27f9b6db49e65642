"""
Extrinsics: how the camera sits on the base, learnt from what commands do to the bearings.

The camera is dead-reckoned from the commanded speed and the measured heading, in axes of the
goal's camera (x right, y forward), and held against the direction psi in which it is seen. That
tells how far off the goal is, where a robot goes that drives straight on (yaw), and how a turn in
place moves its camera (the lever arm). A Kalman filter in modified polar coordinates, which bears
a distance that is not known (Aidala, Hammel 1983): psi [rad], the logarithm of the distance [m],
yaw [rad], and the lever arm forward and left [m], in axes of the camera.
"""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.perception.measurement import Measurement

PSI, RHO, YAW, FORWARD, LEFT = range(5)
FIRST_DISTANCE, FIRST_DEVIATION = 3.0, 1.0  # [m], of the logarithm: one to eight metres
NEAREST = 0.02  # [m]
YAW_WALK = math.radians(1.0)  # of the yaw, as bases crab and models err [rad], in a metre
SLIP = 0.05  # of a travel: what dead reckoning is wrong by
CORRELATION = 6.0  # bearings share the photograph: so many tell as much as one
LEAST_DEVIATION = 2e-3  # of a bearing: what tilt and roll are not known to [rad]
# Deviations from what was told before it is believed, and that of the logarithm of a distance that
# is known: at first, and after an attempt that missed.
SIGNIFICANT, RANGED = (4.0, 3.5), (0.25, 0.5)
# Below which little is gained [rad, m, m]; an offset aside alone is never told apart for certain.
LEAST = np.array([math.radians(2.0), 0.1, math.inf])
LEAST_STEP = 0.02  # between two updates, travel [m] or turn [rad]
NEAR, UNCERTAIN = 0.15, math.radians(1.5)  # distance [m], deviation of a bearing [rad]
GATE = 6.0  # deviations beyond which a bearing begins the path anew
FAULT, MAX_CONTRADICTIONS = 5, 12  # what one bearing beyond it counts, and what is too much


@dataclass(frozen=True, slots=True, eq=False)
class Extrinsics:
    """
    Mean, shape (5,), and covariance, (5, 5), of the place of the camera and of its mount.

    ``told``, shape (3,), is the mount as parameters have it: yaw [rad], and the lever arm forward
    and left [m], turned into axes of the camera.
    ``heading`` error [rad] and ``travel`` [m] are those of the last update and since. ``placed``
    says whether there was any, ``believed`` whether what was learnt differs from what was told;
    ``contradictions`` counts bearings that commands do not explain, less those that they do.
    """

    told: FloatArray
    mean: FloatArray
    covariance: FloatArray
    heading: float = 0.0
    travel: float = 0.0
    placed: bool = False
    believed: bool = False
    contradictions: int = 0

    @property
    def mount(self) -> FloatArray:
        """Yaw [rad], offset forward and left [m] that control goes by, shape (3,)."""
        return self.mean[YAW:] if self.believed else self.told

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


def told_extrinsics(told: FloatArray, deviations: FloatArray) -> Extrinsics:
    """
    Return what is known beforehand: the mount as ``told``, with ``deviations``, shape (3,) each.

    Its lever arm is told in axes of the base.
    """
    yaw, forward, left = told.tolist()
    cosine, sine = math.cos(yaw), math.sin(yaw)
    told = np.array([yaw, cosine * forward + sine * left, cosine * left - sine * forward])
    return Extrinsics(
        told,
        np.concatenate([[0.0, math.log(FIRST_DISTANCE)], told]),
        np.diag(np.concatenate([[1.0, FIRST_DEVIATION**2], deviations**2])),
    )


def placed(before: Extrinsics, bearings: Bearings, deviation: float) -> Extrinsics:
    """Return the belief with the camera seen anew along psi [rad], at any distance."""
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[PSI] = bearings.psi  # the distance is the last one, or that of told_extrinsics
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


def moved(before: Extrinsics, heading: float) -> Extrinsics:
    """Return the belief after its ``travel``, now at a ``heading`` error [rad]."""
    psi, rho, yaw, *lever = before.mean.tolist()
    distance, travel = math.exp(rho), before.travel
    middle = before.heading + 0.5 * math.remainder(heading - before.heading, 2.0 * math.pi)
    ahead = np.array([-math.sin(middle - yaw), math.cos(middle - yaw)])
    swing = camera_axes(heading) - camera_axes(before.heading)
    x, y = distance * math.cos(psi), distance * math.sin(psi)
    new_x, new_y = (travel * ahead + swing @ lever + [x, y]).tolist()
    square = max(new_x * new_x + new_y * new_y, NEAREST**2)
    by_place = np.empty((2, 5))  # derivatives of the new place by the states
    by_place[:, PSI], by_place[:, RHO] = (-y, x), (x, y)
    by_place[:, YAW], by_place[:, FORWARD:] = travel * ahead[::-1] * [1.0, -1.0], swing
    to_polar = np.array([[-new_y, new_x], [new_x, new_y]]) / square
    transition = np.eye(5)
    transition[:2] = to_polar @ by_place
    mean = before.mean.copy()
    turn = math.remainder(math.atan2(new_y, new_x) - psi, 2.0 * math.pi)
    mean[:2] = psi + turn, 0.5 * math.log(square)
    covariance = transition @ before.covariance @ transition.T
    covariance[:2, :2] += np.eye(2) * (SLIP * travel) ** 2 / square
    covariance[YAW, YAW] += YAW_WALK * YAW_WALK * abs(travel)
    return replace(before, mean=mean, covariance=covariance, heading=heading, travel=0.0)


def seen(before: Extrinsics, psi: float, deviation: float) -> tuple[Extrinsics, float]:
    """Return the belief after ``psi`` [rad] is seen, and the innovation in deviations."""
    innovation = math.remainder(psi - before.mean[PSI], 2.0 * math.pi)
    column = before.covariance[:, PSI]
    variance = float(column[PSI]) + CORRELATION * deviation * deviation
    gain = column / variance
    after = replace(
        before,
        mean=before.mean + gain * innovation,
        covariance=before.covariance - np.outer(gain, column),
    )
    return after, innovation / math.sqrt(variance)


def learnt(
    before: Extrinsics, measurement: Measurement, travel: float, *, missed: bool
) -> Extrinsics:
    """
    Return the belief after ``travel`` [m] and a ``measurement``.

    Near the goal bearings say nothing of the mount. Where an attempt has ``missed``, something is
    wrong, and what was learnt is believed sooner.
    """
    # Without a deviation, as the paper's estimator has none, bearings tell nothing of the path.
    known = math.isfinite(measurement.deviation)
    bearings = measurement.bearings if known else None
    deviation = max(measurement.deviation, LEAST_DEVIATION) if bearings else math.nan
    if not before.placed:
        return placed(before, bearings, deviation) if bearings else before
    before = replace(before, travel=before.travel + travel)
    heading = measurement.heading_error
    turn = math.remainder(heading - before.heading, 2.0 * math.pi)
    if not math.isfinite(heading) or max(abs(before.travel), abs(turn)) < LEAST_STEP:
        return before
    after = moved(before, heading)
    if bearings is None or deviation > UNCERTAIN or after.distance < NEAR:
        return after
    after, innovation = seen(after, bearings.psi, deviation)
    if abs(innovation) > GATE:
        anew = placed(before, bearings, deviation)
        return replace(anew, contradictions=before.contradictions + FAULT)
    after = replace(after, contradictions=max(before.contradictions - 1, 0))
    return replace(after, believed=after.believed or is_significant(after, missed))


def is_significant(belief: Extrinsics, missed: bool) -> bool:
    """Return whether what was learnt of the mount differs from what was told, and matters."""
    change = np.abs(belief.mean[YAW:] - belief.told)
    _, distance, *mount = np.sqrt(belief.covariance.diagonal()).tolist()
    deviations = np.array(mount)
    if distance > RANGED[missed]:
        return False
    return bool(np.any((change > SIGNIFICANT[missed] * deviations) & (change > LEAST)))


def camera_axes(heading: float) -> FloatArray:
    """Return the camera's directions ahead and to the left as columns, in axes of the goal's."""
    sine, cosine = math.sin(heading), math.cos(heading)
    return np.array([[-sine, -cosine], [cosine, -sine]])


def at_axle(bearings: Bearings, mount: FloatArray, distance: float) -> Bearings:
    """Return the bearings of the axle in axes of the base, from those of its camera."""
    yaw, lever = float(mount[0]), mount[1:]
    heading = bearings.heading_error
    swing_x, swing_y = ((camera_axes(heading) - camera_axes(0.0)) @ lever).tolist()
    x = distance * math.cos(bearings.psi) - swing_x
    y = distance * math.sin(bearings.psi) - swing_y
    psi, theta = math.atan2(y, x) + yaw, bearings.psi - bearings.phi
    return Bearings(math.remainder(psi, 2.0 * math.pi), math.remainder(psi - theta, 2.0 * math.pi))
