"""
Steering: turns the robot back onto the path, by offset and heading, or by an epipole.

A filter of offset, turn, and the curvature that unequal wheels add is predicted by commands and
corrected by views. Instead, the epipole of the next key view may steer (Becerra et al. 2014):
it is where the image shows the camera of that key view. On the taught way it moves as taught;
an offset turns the robot. Two views tell it, without depths or metres: near the key view
it is undefined, and the one after it counts.
"""

from dataclasses import dataclass, field
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.bases.base import Base, turns_in_place
from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimate.goal_estimate import USUAL_STEP_S
from visual_servo_epipolar.core.geometry.motion import inverse_pose, Twist
from visual_servo_epipolar.core.routes.route import RouteView
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview.estimator import Prior
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.core.twoview.registry import estimate

TURN_NOISE = 0.02  # of the true turn against the commanded one [rad/sqrt(s)]
SLIDE_NOISE = 0.002  # of the base across its heading [m/sqrt(m)]
BIAS_NOISE = 0.01  # by which the curvature of the wheels changes [1/m/sqrt(m)]
FIRST = np.diag([0.3**2, 0.3**2, 0.03**2])
LEAST = np.array([0.0015, 0.0006])  # deviations of one view beside its own: the seam [m, rad]
DAMPING = 1.0  # of the offset along the way: critical
MOST_OFFSET = 1.0  # in steering lengths, beyond which the way back is straight
EPIPOLE_GAIN = 1.5  # turn by what the epipole is off [1/s]
NEAREST = 0.3  # way before a key view at which its epipole counts no more [m]
NOISE_PX = 0.2
LOOK_TURN, LOOK_RATE = 0.5, 0.4  # to either side, where two places look alike [rad], [rad/s]
CRAWL = 0.05  # speed at which a station is come near [m/s]
ESTIMATOR, FEWEST = 'soft_planar', 12  # features that an epipole needs
MOST_DEVIATION = 0.05  # of an epipole that is believed [rad]


@dataclass(frozen=True, eq=False)
class LateralFilter:
    """
    State: ``offset`` to the left [m], ``turn`` to the left [rad], ``bias`` [1/m]; (3,).

    ``covariance``, (3, 3). The bias is what the base adds to the commanded curvature.
    """

    state: FloatArray = field(default_factory=lambda: np.zeros(3))
    covariance: FloatArray = field(default_factory=lambda: FIRST.copy())

    def predicted(self, linear: float, angular: float, curvature: float, dt: float) -> FloatArray:
        """Return the state after ``dt`` [s] of a command, on a path of a ``curvature`` [1/m]."""
        offset, turn, bias = self.state.tolist()
        rate = angular + linear * (bias - curvature)
        middle = turn + 0.5 * rate * dt
        return np.array([offset + linear * math.sin(middle) * dt, turn + rate * dt, bias])

    def moved(self, linear: float, angular: float, curvature: float, dt: float) -> 'LateralFilter':
        """Return the filter after ``dt`` [s] of a command."""
        way = linear * dt
        slope = np.array([[1.0, way, 0.5 * way * way], [0.0, 1.0, way], [0.0, 0.0, 1.0]])
        noise = np.array([SLIDE_NOISE**2 * abs(way), TURN_NOISE**2 * dt, BIAS_NOISE**2 * abs(way)])
        covariance = slope @ self.covariance @ slope.T + np.diag(noise)
        return LateralFilter(self.predicted(linear, angular, curvature, dt), covariance)

    def seen(self, offset: float, turn: float, covariance: FloatArray) -> 'LateralFilter':
        """Return the filter after a view with ``covariance``, (2, 2), of offset and turn."""
        noise = covariance + np.diag(LEAST**2)
        gain = self.covariance[:, :2] @ np.linalg.inv(self.covariance[:2, :2] + noise)
        state = self.state + gain @ (np.array([offset, turn]) - self.state[:2])
        after = self.covariance - gain @ self.covariance[:2]
        return LateralFilter(state, 0.5 * (after + after.T))


def steer(at: LateralFilter, curvature: float, speed: float, settings: FollowSettings) -> Twist:
    """
    Return the twist that brings an offset and a turn to zero along the way.

    With s the way driven, e the offset and t the turn, e' = t and t' = k - k_path: the curvature
    k = k_path - 2 d t / L - e / L^2 makes e'' + 2 d e' / L + e / L^2 = 0, whatever the speed.
    Driving backward turns the sign of s, and with it that of the middle term.
    """
    offset, turn, bias = at.state.tolist()
    length, forward = settings.steering_length, math.copysign(1.0, speed)
    share = max(min(offset / length, MOST_OFFSET), -MOST_OFFSET)
    wanted = curvature - bias - 2.0 * DAMPING * forward * turn / length - share / length
    return Twist(speed, speed * wanted)


def turned_back(turn: float, acceleration: float) -> Twist:
    """Return the twist in place that takes back a ``turn`` [rad], at half of an acceleration."""
    return Twist(0.0, -math.copysign(math.sqrt(acceleration * abs(turn)), turn))


class LookAround:
    """Look around: one turn in place to either side and back, where two places look alike."""

    def __init__(self) -> None:
        self._stamp_ns, self._quarters, self._limiter = -1, 0.0, Limiter()

    def twist(self, stamp_ns: int, last: Twist, base: Base) -> Twist:
        """Return the twist after an image, ``last`` being the one before; of a car none."""
        before_ns = stamp_ns if self._stamp_ns < 0 else self._stamp_ns
        dt, self._stamp_ns = seconds_between(before_ns, stamp_ns), stamp_ns
        rate = min(LOOK_RATE, base.limits.max_angular)
        self._quarters += dt * rate / LOOK_TURN
        if self._quarters >= 4.0 or not turns_in_place(base):
            rate = 0.0
        wanted = Twist(0.0, -rate if 1.0 <= self._quarters < 3.0 else rate)
        ramp_s = self._limiter.ramp_step(dt, USUAL_STEP_S)
        if last != self._limiter.last:  # it was commanded to stand meanwhile
            self._limiter = Limiter(last)
        self._limiter = self._limiter.after(wanted, ramp_s, base)
        return self._limiter.last


def brake(way: float, acceleration: float) -> float:
    """Return the speed from which half of it stops within ``way`` [m], not below a crawl."""
    return max(math.sqrt(acceleration * max(way, 0.0)), CRAWL)


def epipole_error(
    features: Features, view: RouteView, way: float, camera: CameraModel
) -> float | None:
    """
    Return how far left of where it was taught the epipole of a key ``view`` is [rad].

    ``way`` is where on the route the robot is [m]; None where two views do not tell.
    """
    if len(features) < FEWEST or view.way - way < NEAREST or way < view.path.way[0]:
        return None
    seen = observe(features, camera, 0)
    try:
        found = estimate(
            ESTIMATOR,
            seen.current,
            seen.desired,
            noise=NOISE_PX * seen.resolution,
            prior=Prior(),
            seed=(0, 0),
        )
    except DegenerateGeometryError:
        return None
    if not math.sqrt(float(np.max(np.diag(found.covariance)))) < MOST_DEVIATION:
        return None
    x, y, _ = inverse_pose(view.path.pose_at(way)).tolist()
    return math.remainder(-found.bearings.current - math.atan2(y, x), 2.0 * math.pi)
