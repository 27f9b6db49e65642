"""
Extrinsics: how the camera sits on the base, learnt from what commands do to the bearings.

The camera is dead-reckoned from the commanded speed and the measured heading, in axes of the
goal's camera (x right, y forward), and held against the direction psi in which it is seen. That
tells how far off the goal is, where a robot goes that drives straight on (yaw), and how a turn in
place moves its camera (the lever arm). A Kalman filter in modified polar coordinates, which bears
a distance that is not known (Aidala, Hammel 1983): psi [rad], the logarithm of the distance [m],
yaw [rad], and the lever arm forward and left [m], in axes of the camera.

What bearings tell of the mount is learnt at once, and believed where it is significant. Keyframes
of the map tell a tenth of a degree of the yaw by where they were driven: a camera that looks aside
of that ends aside of the line that it follows, and a principal point that is off by a few pixels
does the same.
"""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, ROUNDING
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING, least_squares
from visual_servo_epipolar.core.mapping.factors import UNKNOWN_SCALE
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import HEADING, MapSettings, VIEW
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing
from visual_servo_epipolar.core.twoview.measurement import Measurement

PSI, RHO, YAW, FORWARD, LEFT = range(5)
IDENTITY = np.eye(5)
NEAREST = 0.02  # [m]
FIRST_DISTANCE = 3.0  # [m], of an unknown scale: one to eight metres
LENS = 0.02  # of a turn of a radian, that two views may show wrong: the lens is not known to them
YAW_WALK = math.radians(1.0)  # of the yaw, as bases crab and models err [rad], in a metre
DIRECTION = 0.05  # of a travel, that it leads elsewhere, or farther: least deviation [rad]
CORRELATION = 6.0  # bearings share the photograph: so many tell as much as one
LEAST_DEVIATION = 2e-3  # of a bearing: what tilt and roll are not known to [rad]
REMEMBERED = 0.1  # least deviation of the logarithm of a distance by a memory of views
# Change of the logarithm of a distance: at the end of iterations, and of one step at most.
CONVERGED, LONGEST_STEP, MOST_ITERATIONS = 0.02, 0.7, 8
# Deviation of the logarithm of a distance that is known: at first, and after a missed attempt.
RANGED = (0.25, 0.5)
MAX_CONTRADICTIONS = 12  # beyond which bearings contradict what was driven
# Deviations from the configured one, until believed: at first, after a miss.
SIGNIFICANT = 4.0, 3.5
# Below which little is gained [rad, m, m]; an offset aside alone is never certain.
LEAST = (math.radians(2.0), 0.1, math.inf)
# Of a yaw that driven keyframes tell [rad], and its deviations from the one gone by.
LEAST_OF_DRIVE, SIGNIFICANT_OF_DRIVE = math.radians(0.15), 3.0
MOST_OF_DRIVE = math.radians(0.5)  # deviation: far off a map may be wrong by more
LAG = MapSettings().lag
LEAST_STEP = 0.02  # between two updates, travel [m] or turn [rad]
NEAR, UNCERTAIN = 0.15, math.radians(1.5)  # distance [m], deviation of a bearing [rad]
GATE = 6.0  # deviations beyond which a bearing begins the path anew
PLAUSIBLE = 5.0  # deviations from the configured mount, beyond which another thing was learnt
FAULT = 5  # what one bearing beyond the gate counts as a contradiction


@dataclass(frozen=True, eq=False)
class Extrinsics:
    """
    Mean, shape (5,), and covariance, (5, 5), of the place of the camera and of its mount.

    ``configured``, shape (3,), is the mount by the parameters: yaw [rad], and the lever arm
    forward and left [m], turned into axes of the camera; ``deviations``, shape (3,), are theirs.
    ``heading`` error [rad] and ``travel`` [m] are those of the last update and since. ``placed``
    says whether there was any, ``believed`` whether the learnt mount differs from that;
    ``contradictions`` counts bearings that commands do not explain, less those that they do;
    ``remembers`` says whether the bearings are those of a memory of views, ``ambiguous`` whether
    two geometries have fitted one of them: it is believed only after a miss then.
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
    ambiguous: bool = False

    @property
    def mount(self) -> FloatArray:
        """Yaw [rad], offset forward and left [m] that control goes by, shape (3,)."""
        return self.mean[YAW:] if self.believed else self.configured

    @property
    def likely(self) -> FloatArray:
        """The likeliest mount, shape (3,), believed or not: the configured one may be a guess."""
        return self.mean[YAW:]

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
        np.diag(np.concatenate([[1.0, UNKNOWN_SCALE**2], deviations**2])),
    )


class PathPrediction(NamedTuple):
    """Place after a drive: ``mean``, (5,), its ``transition``, (5, 5), and distance squared."""

    mean: FloatArray
    transition: FloatArray
    square: float


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
    # The distance is the last one, or that of configured_extrinsics.
    begun = known_anew(before, RHO, float(before.mean[RHO]), UNKNOWN_SCALE**2)
    begun = known_anew(begun, PSI, bearings.psi, deviation**2)
    return replace(begun, heading=bearings.heading_error, travel=0.0, placed=True)


def known_anew(before: Extrinsics, of: int, value: float, variance: float) -> Extrinsics:
    """Return the belief with one of its states as if nothing had been known of it before."""
    mean, covariance = before.mean.copy(), before.covariance.copy()
    mean[of] = value
    covariance[of] = covariance[:, of] = 0.0
    covariance[of, of] = variance
    return replace(before, mean=mean, covariance=covariance)


def moved(before: Extrinsics, heading: float, *, at: FloatArray | None = None) -> Extrinsics:
    """Return the belief after its ``travel`` to a ``heading`` error [rad], linear about ``at``."""
    at = before.mean if at is None else at
    path = predict_path(at, (before.heading, heading), before.travel)
    covariance = path.transition @ before.covariance @ path.transition.T
    slipped = (DIRECTION * before.travel) ** 2 / path.square
    covariance[PSI, PSI] += slipped
    covariance[RHO, RHO] += slipped
    covariance[YAW, YAW] += YAW_WALK * YAW_WALK * abs(before.travel)
    if not before.remembers:
        turn = math.remainder(heading - before.heading, 2.0 * math.pi)
        covariance[PSI, PSI] += LENS * LENS * abs(turn)
    mean = path.mean
    if at is not before.mean:
        mean = mean + path.transition @ (before.mean - at)
    return replace(before, mean=mean, covariance=covariance, heading=heading, travel=0.0)


def moved_to(before: Extrinsics, heading: float, psi: float, deviation: float) -> Extrinsics:
    """
    Return the belief after its ``travel``, linear about where ``psi`` [rad] has the camera.

    A distance of which a factor e is unknown turns psi by too much for one tangent: what a
    bearing tells is overrated, and the mount pays for it. Hence the update is iterated, Gauss and
    Newton's way, before it is done (Bell and Cathey 1993).
    """

    def linearise(at: FloatArray, number: int) -> _Towards:
        ahead = moved(before, heading, at=at)
        spread = float(ahead.covariance[PSI, PSI]) + CORRELATION * deviation * deviation
        innovation = math.remainder(psi - ahead.mean[PSI], 2.0 * math.pi)
        transition = predict_path(at, (before.heading, heading), before.travel).transition
        step = before.covariance @ transition[PSI] * (innovation / spread)
        return _Towards(at, before.mean + step)

    def stepped(at: FloatArray, to: _Towards, change: FloatArray) -> tuple[FloatArray, bool]:
        way = float(abs(change[RHO]))
        if way < CONVERGED:
            return at, True
        return at - change * min(LONGEST_STEP / way, 1.0), False

    at, _ = least_squares(before.mean, linearise, stepped, MOST_ITERATIONS)
    return moved(before, heading, at=at)


class _Towards(NamedTuple):
    """States, (5,), and those by the measurement as linear about them: by its gain (Kalman)."""

    at: FloatArray
    best: FloatArray

    def change(self) -> FloatArray:
        return self.at - self.best


def seen(
    before: Extrinsics, psi: float, deviation: float, *, anew: bool = False
) -> tuple[Extrinsics, float]:
    """
    Return the belief after ``psi`` [rad] is seen, and the innovation in deviations.

    ``anew`` it takes the place of the predicted one: it is by other views, to which the lens is
    known otherwise.
    """
    innovation = math.remainder(psi - before.mean[PSI], 2.0 * math.pi)
    noise = CORRELATION * deviation * deviation
    expected = float(before.covariance[PSI, PSI]) + (noise + LENS * LENS if anew else noise)
    if anew:
        after = known_anew(before, PSI, psi, noise)
    else:
        after = corrected(before, PSI, innovation, noise)
    return after, innovation / math.sqrt(expected)


def corrected(before: Extrinsics, of: int, innovation: float, noise: float) -> Extrinsics:
    """Return the belief after one of its states was measured, with variance ``noise`` (Kalman)."""
    column = before.covariance[:, of]
    gain = column / (float(column[of]) + noise)
    return replace(
        before,
        mean=before.mean + gain * innovation,
        covariance=before.covariance - gain[:, None] * column,
    )


def ranged(before: Extrinsics, distance: float, deviation: float) -> Extrinsics:
    """
    Return the belief after a memory of views gave the ``distance`` [m], by what was driven.

    All that it tells has one scale, and hence one error: the next view of it adds nothing to what
    the belief has of it already, and a distance that contradicts it is dropped.
    """
    distance = max(distance, NEAREST)
    innovation = math.log(distance) - before.mean[RHO]
    variance, known = max(REMEMBERED, deviation / distance) ** 2, before.covariance[RHO, RHO]
    if innovation * innovation > CONTRADICTING * (variance + known):  # that of before is wrong
        return known_anew(before, RHO, math.log(distance), variance)
    if known <= variance:
        return before
    return corrected(before, RHO, innovation, variance * known / (known - variance))


def close_by(before: Extrinsics) -> Extrinsics:
    """Return the belief; close by the goal with a direction no better than the base obeys."""
    if not before.distance < NEAR:
        return before
    covariance = before.covariance.copy()
    covariance[PSI, PSI] = max(covariance[PSI, PSI], (LAG / before.distance) ** 2)
    return replace(before, covariance=covariance)


def update_extrinsics(
    before: Extrinsics, measurement: Measurement, travel: float, *, missed: bool
) -> Extrinsics:
    """Return the belief after ``travel`` [m] and a ``measurement``; sooner if ``missed``."""
    remembers = measurement.remembered
    if measurement.rivals:  # which of two it is, its way is to tell first
        return replace(before, remembers=remembers, placed=False, ambiguous=True)
    # Without a deviation, as the paper's estimator has none, bearings tell nothing of the path.
    bearings = measurement.bearings if math.isfinite(measurement.deviation) else None
    deviation = max(measurement.deviation, LEAST_DEVIATION) if bearings else math.nan
    if not before.placed:
        before = replace(before, remembers=remembers)
        return placed(before, bearings, deviation) if bearings else before
    before = replace(before, travel=before.travel + travel)
    heading = measurement.heading_error
    turn = math.remainder(heading - before.heading, 2.0 * math.pi)
    if not math.isfinite(heading) or max(abs(before.travel), abs(turn)) < LEAST_STEP:
        return before
    # Two views do not know the lens: what they are off by is no motion.
    switched = remembers is not before.remembers
    bearings = None if deviation > UNCERTAIN else bearings
    if bearings and not switched:
        after = moved_to(before, heading, bearings.psi, deviation)
    else:
        after = moved(before, heading)
    if measurement.offset is not None:
        after = ranged(after, math.hypot(*measurement.offset), measurement.offset_deviation)
    if bearings is None or after.distance < NEAR:
        return close_by(after)
    before, after = (replace(each, remembers=remembers) for each in (before, after))
    after, innovation = seen(after, bearings.psi, deviation, anew=switched)
    if (has_leapt := abs(innovation) > GATE) or not (switched or is_plausible(after)):
        begun = before if has_leapt else unplaced(before.configured, before.deviations)
        faults = before.contradictions + FAULT
        anew = replace(begun, contradictions=faults, ambiguous=before.ambiguous)
        return placed(anew, bearings, deviation)
    if switched:
        return after
    believed = after.believed or is_significant(after, missed)
    return replace(after, contradictions=max(before.contradictions - 1, 0), believed=believed)


def with_driven_yaw(before: Extrinsics, geometry: Geometry, *, missed: bool) -> Extrinsics:
    """Return the belief with the yaw by where keyframes were driven, if it is another one."""
    if before.ambiguous and not missed:  # the map may be of the other geometry
        return before
    off, variance = driven_yaw(before, geometry)
    known, deviation = float(before.covariance[YAW, YAW]), math.sqrt(variance)
    least = max(SIGNIFICANT_OF_DRIVE * deviation, LEAST_OF_DRIVE)
    matters = before.believed or abs(float(before.mean[YAW]) + off - before.mount[0]) > least
    if not (matters and variance < known and deviation <= MOST_OF_DRIVE):
        return before  # all that a map says has one error, and counts once
    after = corrected(before, YAW, off, variance * known / (known - variance))
    return replace(after, believed=True) if is_plausible(after) else before


def driven_yaw(belief: Extrinsics, geometry: Geometry) -> tuple[float, float]:
    """
    Return by how much the likely yaw is off [rad], by the keyframes of a map, and the variance.

    A camera that looks aside of where it is driven has the driven places of its keyframes turned
    against those of the images. Place and scale of these are unknown; the lever arm, which a turn
    swings, as far as settings tell it. A base may be behind its commands by its lag.
    """
    yaw, *lever = belief.likely.tolist()
    views, driven = geometry.unknowns.views, geometry.window.driven_places
    count, cosine, sine = len(views), math.cos(yaw), math.sin(yaw)
    driven = (driven - driven.mean(0)) @ np.array([[cosine, -sine], [sine, cosine]])
    swings = np.array([camera_swing(0.0, heading) for heading in views[:, HEADING].tolist()])
    slopes = np.zeros((count, 2, 6))
    slopes[..., 0], slopes[..., 1:3] = np.column_stack([driven[:, 1], -driven[:, 0]]), swings
    slopes[..., 3], slopes[..., 4:] = driven, np.eye(2)
    off = views[:, :HEADING] - swings @ lever - driven
    late = np.zeros((count, 2, count))
    late[range(count), 0, range(count)] = -LAG * np.sin(views[:, HEADING])
    late[range(count), 1, range(count)] = LAG * np.cos(views[:, HEADING])
    seen = geometry.root[: VIEW * count].reshape(count, VIEW, -1)[:, :HEADING]
    root = np.concatenate([seen, late], axis=2).reshape(2 * count, -1)
    errors = root @ root.T + ROUNDING * np.eye(2 * count)
    by_place = slopes.reshape(2 * count, 6)
    weighted = np.linalg.solve(errors, np.column_stack([by_place, off.ravel()]))
    deviations = np.array(
        [*np.maximum(belief.deviations, ROUNDING), UNKNOWN_SCALE, np.inf, np.inf]
    )
    covariance = np.linalg.inv(by_place.T @ weighted[:, :6] + np.diag(deviations**-2))
    changes = (covariance @ by_place.T @ weighted[:, 6]).tolist()
    return changes[0] / max(1.0 + changes[3], 0.5), float(covariance[0, 0])


def is_plausible(belief: Extrinsics) -> bool:
    """Return whether the mount may be what was learnt, and not a path that led nowhere."""
    changes = np.abs(belief.mean[YAW:] - belief.configured)
    deviations = np.maximum(belief.deviations, [DIRECTION, 0.0, 0.0])
    return bool((changes <= PLAUSIBLE * deviations).all())


def is_significant(belief: Extrinsics, missed: bool) -> bool:
    """Return whether what was learnt of the mount differs from the configured one, and matters."""
    _, distance, *deviations = np.sqrt(belief.covariance.diagonal()).tolist()
    if distance > RANGED[missed] or (belief.ambiguous and not missed):
        return False
    changes = (belief.mean[YAW:] - belief.configured).tolist()
    return any(
        abs(change) > SIGNIFICANT[missed] * deviation and abs(change) > least
        for change, deviation, least in zip(changes, deviations, LEAST, strict=True)
    )
