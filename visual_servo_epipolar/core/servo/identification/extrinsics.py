"""
Extrinsics: how the camera sits on the base, learnt from what commands do to the bearings.

The camera is dead-reckoned from the commanded speed and the measured heading, in axes of the
goal's camera (x right, y forward), and held against the direction psi in which it is seen. That
tells how far off the goal is, where a robot goes that drives straight on (yaw), and how a turn in
place moves its camera (the lever arm). A Kalman filter in modified polar coordinates, which bears
a distance that is not known (Aidala, Hammel 1983): psi [rad], the logarithm of the distance [m],
yaw [rad], and the lever arm forward and left [m], in axes of the camera.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing
from visual_servo_epipolar.core.values import changed

PSI, RHO, YAW, FORWARD, LEFT = range(5)
IDENTITY = np.eye(5)
FIRST_DISTANCE, FIRST_DEVIATION = 3.0, 1.0  # [m], of the logarithm: one to eight metres
NEAREST = 0.02  # [m]
LENS = 0.02  # of a turn of a radian, that two views may show wrong: nobody has told them the lens
YAW_WALK = math.radians(1.0)  # of the yaw, as bases crab and models err [rad], in a metre
SLIP = 0.05  # of a travel: what dead reckoning is wrong by
CORRELATION = 6.0  # bearings share the photograph: so many tell as much as one
LEAST_DEVIATION = 2e-3  # of a bearing: what tilt and roll are not known to [rad]
# Deviations from what was told before it is believed, and that of the logarithm of a distance that
# is known: at first, and after an attempt that missed.
SIGNIFICANT, RANGED = (4.0, 3.5), (0.25, 0.5)
# Below which little is gained [rad, m, m]; an offset aside alone is never told apart for certain.
LEAST = (math.radians(2.0), 0.1, math.inf)
# Of a yaw that legs by a memory of views tell, and its deviations from what was told.
LEAST_OF_LEGS, SIGNIFICANT_OF_LEGS = math.radians(0.15), 2.0
REMEMBERED = 0.1  # least deviation of the logarithm of a distance by a memory of views
LEAST_STEP = 0.02  # between two updates, travel [m] or turn [rad]
NEAR, UNCERTAIN = 0.15, math.radians(1.5)  # distance [m], deviation of a bearing [rad]
GATE = 6.0  # deviations beyond which a bearing begins the path anew
# Deviations from what was told beyond which it is not the mount that was learnt, and the least
# deviation of a yaw that walks [rad].
PLAUSIBLE, WALKED = 5.0, 0.05
FAULT, MAX_CONTRADICTIONS = 5, 12  # what one bearing beyond it counts, and what is too much


@dataclass(frozen=True, eq=False)  # without slots: ``values.changed``
class Extrinsics:
    """
    Mean, shape (5,), and covariance, (5, 5), of the place of the camera and of its mount.

    ``told``, shape (3,), is the mount as parameters have it: yaw [rad], and the lever arm forward
    and left [m], turned into axes of the camera; ``deviations``, shape (3,), are theirs.
    ``heading`` error [rad] and ``travel`` [m] are those of the last update and since. ``placed``
    says whether there was any, ``believed`` whether what was learnt differs from what was told;
    ``contradictions`` counts bearings that commands do not explain, less those that they do;
    ``remembers`` says whether the bearings are those of a memory of views.
    """

    told: FloatArray
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
        return self.mean[YAW:] if self.believed else self.told

    @property
    def likely(self) -> FloatArray:
        """The likeliest mount, shape (3,), be it believed or not: what was told may be a guess."""
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


def told_extrinsics(told: FloatArray, deviations: FloatArray) -> Extrinsics:
    """Return what is known beforehand: mount and deviations, (3,) each, in base axes."""
    yaw, forward, left = told.tolist()
    cosine, sine = math.cos(yaw), math.sin(yaw)
    told = np.array([yaw, cosine * forward + sine * left, cosine * left - sine * forward])
    return _unplaced(told, deviations)


def _unplaced(told: FloatArray, deviations: FloatArray) -> Extrinsics:
    return Extrinsics(
        told,
        deviations,
        np.concatenate([[0.0, math.log(FIRST_DISTANCE)], told]),
        np.diag(np.concatenate([[1.0, FIRST_DEVIATION**2], deviations**2])),
    )


def placed(before: Extrinsics, bearings: Bearings, deviation: float) -> Extrinsics:
    """Return the belief with the camera seen anew along psi [rad], at any distance."""
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[PSI] = bearings.psi  # the distance is the last one, or that of told_extrinsics
    covariance[:2] = covariance[:, :2] = 0.0
    covariance[PSI, PSI], covariance[RHO, RHO] = deviation**2, FIRST_DEVIATION**2
    return changed(
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
    right, ahead = -travel * math.sin(middle - yaw), travel * math.cos(middle - yaw)
    swing = camera_swing(before.heading, heading)
    by_forward, by_left = (swing @ lever).tolist()
    x, y = distance * math.cos(psi), distance * math.sin(psi)
    new_x, new_y = right + by_forward + x, ahead + by_left + y
    square = max(new_x * new_x + new_y * new_y, NEAREST**2)
    (right_f, right_l), (ahead_f, ahead_l) = swing.tolist()
    # derivatives of the new place by the states
    by_place = np.array([[-y, x, ahead, right_f, right_l], [x, y, -right, ahead_f, ahead_l]])
    east, north = new_x / square, new_y / square
    transition = IDENTITY.copy()
    transition[:2] = np.array([[-north, east], [east, north]]) @ by_place
    mean = before.mean.copy()
    turn = math.remainder(math.atan2(new_y, new_x) - psi, 2.0 * math.pi)
    mean[:2] = psi + turn, 0.5 * math.log(square)
    covariance = transition @ before.covariance @ transition.T
    slipped = (SLIP * travel) ** 2 / square
    covariance[PSI, PSI] += slipped
    covariance[RHO, RHO] += slipped
    covariance[YAW, YAW] += YAW_WALK * YAW_WALK * abs(travel)
    if not before.remembers:
        turn = math.remainder(heading - before.heading, 2.0 * math.pi)
        covariance[PSI, PSI] += LENS * LENS * abs(turn)
    return changed(before, mean=mean, covariance=covariance, heading=heading, travel=0.0)


def seen(before: Extrinsics, psi: float, deviation: float) -> tuple[Extrinsics, float]:
    """Return the belief after ``psi`` [rad] is seen, and the innovation in deviations."""
    innovation = math.remainder(psi - before.mean[PSI], 2.0 * math.pi)
    noise = CORRELATION * deviation * deviation
    spread = math.sqrt(float(before.covariance[PSI, PSI]) + noise)
    return _corrected(before, PSI, innovation, noise), innovation / spread


def seen_anew(before: Extrinsics, psi: float, deviation: float) -> tuple[Extrinsics, float]:
    """Return the belief with ``psi`` [rad] in place of the predicted one, and the innovation."""
    noise = CORRELATION * deviation * deviation + LENS * LENS
    innovation = math.remainder(psi - before.mean[PSI], 2.0 * math.pi)
    innovation /= math.sqrt(float(before.covariance[PSI, PSI]) + noise)
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[PSI] = psi
    covariance[PSI] = covariance[:, PSI] = 0.0
    covariance[PSI, PSI] = CORRELATION * deviation * deviation
    return changed(before, mean=mean, covariance=covariance), innovation


def _corrected(before: Extrinsics, of: int, innovation: float, noise: float) -> Extrinsics:
    """Return the belief after one of its states was measured, with variance ``noise`` (Kalman)."""
    column = before.covariance[:, of]
    gain = column / (float(column[of]) + noise)
    return changed(
        before,
        mean=before.mean + gain * innovation,
        covariance=before.covariance - gain[:, None] * column,
    )


def update_extrinsics(
    before: Extrinsics, measurement: Measurement, travel: float, *, missed: bool
) -> Extrinsics:
    """Return the belief after ``travel`` [m] and a ``measurement``; sooner if ``missed``."""
    # Without a deviation, as the paper's estimator has none, bearings tell nothing of the path.
    known = math.isfinite(measurement.deviation)
    bearings = measurement.bearings if known else None
    deviation = max(measurement.deviation, LEAST_DEVIATION) if bearings else math.nan
    remembers = measurement.remembered
    if not before.placed:
        before = changed(before, remembers=remembers)
        return placed(before, bearings, deviation) if bearings else before
    before = changed(before, travel=before.travel + travel)
    heading = measurement.heading_error
    turn = math.remainder(heading - before.heading, 2.0 * math.pi)
    if not math.isfinite(heading) or max(abs(before.travel), abs(turn)) < LEAST_STEP:
        return before
    after = moved(before, heading)
    if measurement.offset is not None:
        after = ranged(after, math.hypot(*measurement.offset), measurement.offset_deviation)
    if bearings is None or deviation > UNCERTAIN or after.distance < NEAR:
        return after
    # Two views do not know the lens: what they are off by is no motion.
    switched = remembers is not before.remembers
    before = changed(before, remembers=remembers)
    seen_now = seen_anew if switched else seen
    after, innovation = seen_now(changed(after, remembers=remembers), bearings.psi, deviation)
    if abs(innovation) > GATE:
        anew = placed(before, bearings, deviation)
        return changed(anew, contradictions=before.contradictions + FAULT)
    if switched:
        return after
    if not is_plausible(after):
        anew = placed(_unplaced(before.told, before.deviations), bearings, deviation)
        return changed(anew, contradictions=before.contradictions + FAULT)
    return changed(
        after,
        contradictions=max(before.contradictions - 1, 0),
        believed=after.believed or is_significant(after, missed),
    )


def ranged(before: Extrinsics, distance: float, deviation: float) -> Extrinsics:
    """Return the belief after a memory of views told the ``distance`` [m], by what was driven."""
    distance = max(distance, NEAREST)
    innovation = math.log(distance) - before.mean[RHO]
    return _corrected(before, RHO, innovation, max(REMEMBERED, deviation / distance) ** 2)


def with_yaw(before: Extrinsics, yaw: float, deviation: float) -> Extrinsics:
    """Return the belief after legs showed a ``yaw`` [rad], if it is not the one gone by."""
    off = abs(math.remainder(yaw - before.mount[0], 2.0 * math.pi))
    if not (before.believed or off > max(SIGNIFICANT_OF_LEGS * deviation, LEAST_OF_LEGS)):
        return before
    innovation = math.remainder(yaw - before.mean[YAW], 2.0 * math.pi)
    after = _corrected(before, YAW, innovation, deviation * deviation)
    return changed(after, believed=True) if is_plausible(after) else before


def is_plausible(belief: Extrinsics) -> bool:
    """Return whether the mount may be what was learnt, and not a path that led nowhere."""
    changes = np.abs(belief.mean[YAW:] - belief.told)
    deviations = np.maximum(belief.deviations, [WALKED, 0.0, 0.0])
    return bool((changes <= PLAUSIBLE * deviations).all())


def is_significant(belief: Extrinsics, missed: bool) -> bool:
    """Return whether what was learnt of the mount differs from what was told, and matters."""
    _, distance, *deviations = np.sqrt(belief.covariance.diagonal()).tolist()
    if distance > RANGED[missed]:
        return False
    changes = (belief.mean[YAW:] - belief.told).tolist()
    return any(
        abs(change) > SIGNIFICANT[missed] * deviation and abs(change) > least
        for change, deviation, least in zip(changes, deviations, LEAST, strict=True)
    )
