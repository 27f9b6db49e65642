"""Dead reckoning: travel, distance and rates between two images, by commands."""

from dataclasses import replace
import math
from typing import NamedTuple

from visual_servo_epipolar.core.estimate.goal_estimate import MotionState, usual_step
from visual_servo_epipolar.core.estimate.odometry import Odometry
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.prediction import is_late
from visual_servo_epipolar.core.odometry.increments import Motion, OdometryIncrement
from visual_servo_epipolar.core.odometry.legs import Leg, Slope
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import Identification, ServoState, ViewState
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.perceive import Perception
from visual_servo_epipolar.core.twoview.rolling_shutter import OF_ONE_IMAGE

RATE_SMOOTHING = 0.4  # weight of the newest value in an exponential mean


class Actuation(NamedTuple):
    """
    What acted on the base in the ``dt`` [s] since the last image: ``twist``, its mean.

    ``before`` is the speed that acted until then [m/s], ``longest`` the one command that acted
    for the longest part. Of a base that obeys in time they are the last commands.
    """

    dt: float
    twist: Twist
    before: float
    longest: Twist

    def motion(self, latency: float) -> Motion:
        """Return the motion of commands that act late by ``latency`` [s]."""
        turn = self.twist.angular * self.dt
        if self.dt == 0.0:
            return Motion(0.0, turn)
        late, linear = min(latency / self.dt, 1.0), self.twist.linear
        return Motion((linear + late * (self.before - linear)) * self.dt, turn)


def actuation(state: ServoState, stamp_ns: int, dt: float, settings: ServoSettings) -> Actuation:
    """Return what acted on the base since the last image, ``dt`` [s] before ``stamp_ns``."""
    if not is_late(settings) or state.measurement is None or dt == 0.0:
        return Actuation(dt, state.twist, state.motion.last_linear, state.twist)
    window = state.measurement.stamp_ns, stamp_ns, settings.latency
    twist, spans = state.motion.sent.mean(*window), state.motion.sent.acting(*window)
    longest = max(spans, key=lambda span: span[0])[1] if spans else STANDSTILL
    return Actuation(dt, twist, twist.linear, longest)


class DrivenInterval(NamedTuple):
    """Drive since the last image: what ``acted``, its ``increment``, ``odometry``'s worth."""

    acted: Actuation
    odometry: Odometry
    increment: OdometryIncrement

    @property
    def travel(self) -> float:
        """The way [m], backward negative."""
        return self.increment.motion.way


def drive_since(
    state: ServoState, perception: Perception, dt: float, settings: ServoSettings
) -> DrivenInterval:
    """Return what was driven since the last image, ``dt`` [s] before this ``perception``."""
    acted = actuation(state, perception.measurement.stamp_ns, dt, settings)
    observation = perception.observation
    wheels = None if observation is None or not settings.odometry else observation.odometry
    commanded = acted.motion(settings.latency)
    return DrivenInterval(acted, *state.identified.odometry.after(wheels, commanded, dt, settings))


def reckon(
    state: ServoState,
    measurement: Measurement,
    identified: Identification,
    drive: DrivenInterval,
    settings: ServoSettings,
) -> tuple[Leg | None, MotionState]:
    """Return leg and motion after a ``drive``; a leg by another mount is forgotten."""
    extrinsics, acted = identified.extrinsics, drive.acted
    known, leg = state.identified.extrinsics, state.law.leg
    if extrinsics is not None and extrinsics.believed != (known is not None and known.believed):
        leg = None
    previous = state.measurement
    if leg is not None and previous is not None and previous.bearings is not None:
        leg = leg.extended(previous.bearings, acted.twist.linear * acted.dt)
    # The most that was driven backward since the last image: commands act late.
    fastest = max(-state.twist.linear, -state.motion.last_linear, 0.0)
    backward = fastest * (acted.dt or usual_step(state.view.period))
    return leg, replace(
        state.motion,
        distance=_distance(state, acted, settings),
        slope=_slope(state, measurement, acted),
        last_linear=state.twist.linear,
        reversed=state.motion.reversed + backward,
    )


def _distance(state: ServoState, acted: Actuation, settings: ServoSettings) -> float:
    """Return d_hat [m], integrated by the applied speed (18)."""
    if math.isnan(state.motion.distance):
        return max(settings.initial_distance, settings.min_distance)
    previous = state.measurement
    if previous is None or previous.bearings is None:
        return state.motion.distance
    # sigma of the geometry itself, also under the printed law: this is kinematics.
    rate = equations.distance_rate(
        acted.twist.linear, previous.bearings.epipole_current, sigma=previous.bearings.sigma
    )
    return max(state.motion.distance + rate * acted.dt, settings.min_distance)


def _slope(state: ServoState, measurement: Measurement, acted: Actuation) -> Slope:
    """Return the slope of D, as the map gives it, or updated by what acted in step 2."""
    slope = state.motion.slope
    if measurement.difference_slope > 0.0:
        return Slope(measurement.difference_slope, slope.weight)
    previous = state.measurement
    if not state.phase.straight or previous is None:
        return slope
    if (measurement.bearings is None) is not (previous.bearings is None):
        return slope  # it was compensated by another rotation
    change = measurement.difference - previous.difference
    return slope.updated(change, acted.twist.linear * acted.dt)


def usual_period(before: float, dt: float) -> float:
    """Return the time between two images [s], smoothed, after one of ``dt`` [s]."""
    if math.isnan(before):
        return dt or math.nan
    if dt == 0.0:  # stamps that leap tell nothing of it
        return before
    return before + OF_ONE_IMAGE * (dt - before)


def jitter(view: ViewState, dt: float) -> float:
    """Return the mean by which the time between images differs from its mean [s], smoothed."""
    before = 0.0 if view.measurement is None else view.measurement.jitter
    if dt == 0.0 or math.isnan(view.period):
        return before
    return before + OF_ONE_IMAGE * (abs(dt - view.period) - before)


def desired_rate(state: ServoState, measurement: Measurement, dt: float) -> float:
    """Return the rate of the bearing of e_du [rad/s], smoothed; 0 where it is unknown."""
    previous = state.measurement
    if previous is None or previous.bearings is None or measurement.bearings is None or dt == 0.0:
        return 0.0
    rate = (measurement.bearings.chi - previous.bearings.chi) / dt
    return state.law.desired_rate + RATE_SMOOTHING * (rate - state.law.desired_rate)
