"""Update of the state by a measurement: way, latch, identification, settling."""

from dataclasses import replace
import math

from visual_servo_epipolar.core.estimators.base import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.decisions import is_close, row_of
from visual_servo_epipolar.core.laws.phases.conditions import has_turned, is_untrusted
from visual_servo_epipolar.core.mapping.map_measurement import MapMeasurement
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import fresh_memory
from visual_servo_epipolar.core.perception.perceive import Perception, with_difference
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle, offset_at_axle
from visual_servo_epipolar.core.servo import way
from visual_servo_epipolar.core.servo.anticipation import as_obeyed, longest_obeyed
from visual_servo_epipolar.core.servo.identification.dead_band import DeadBand, learns
from visual_servo_epipolar.core.servo.identification.delay import Delay
from visual_servo_epipolar.core.servo.identification.extrinsics import Extrinsics, learnt
from visual_servo_epipolar.core.servo.identification.slope import Slope
from visual_servo_epipolar.core.servo.identification.straight_leg import straight_on
from visual_servo_epipolar.core.servo.remembering import MapState, measured, remembered
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import with_settled
from visual_servo_epipolar.core.servo.sparing import is_missed, looked_again, spared_after
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.steadying import Motion
from visual_servo_epipolar.core.values import changed

BIAS_SMOOTHING = 0.2  # weight of the newest value in an exponential mean
MANY_RESTARTS = 4  # of step 1: something is wrong, as after an attempt that missed


def updated(
    state: ServoState,
    perception: Perception,
    dt: float,
    settings: ServoSettings,
    told: ServoSettings | None = None,
) -> ServoState:
    """
    Return the state updated by a ``perception`` ``dt`` [s] after the last, unclassified.

    ``settings`` have what was learnt of the base, those ``told`` have not; None is the same.
    """
    previous, stamp_ns = state.measurement, perception.measurement.stamp_ns
    obeyed = as_obeyed(state, stamp_ns, dt, settings)
    commanded = Motion(way.driven(obeyed, dt, settings), obeyed.twist.angular * dt)
    pose = _odometry_pose(perception, settings)
    odometry, both = state.identified.odometry.checked(pose, commanded, dt, settings)
    driven = both.motion.way
    views, reading = remembered(
        state.view.map, perception, both, settings, dt=dt if state.phase.runs else 0.0
    )
    measurement = measured(perception, reading, views, settings)
    if is_missed(perception, measurement, settings):
        perception = looked_again(state, perception, settings)
        measurement = measured(perception, reading, views, settings)
    memory = spared_after(perception.memory, measurement, reading, views)
    extrinsics = learnt(
        state.identified.extrinsics or settings.extrinsics,
        measurement,
        driven,
        missed=state.run.attempts > 1 or state.run.restarts >= MANY_RESTARTS,
    )
    if extrinsics.contradicts:
        perception, views = _disproved(perception, settings), MapState()
        measurement, extrinsics, reading = perception.measurement, settings.extrinsics, None
        memory = perception.memory
    straight = None
    if state.phase.straight:
        straight, extrinsics = straight_on(state.identified.straight, reading, driven, extrinsics)
    measurement = _of_the_axle(measurement, extrinsics)
    odometry = odometry.judged(measurement)
    bias = _rotation_bias(state, measurement)
    measurement = _without_bias(measurement, bias)
    if extrinsics.believed != (
        state.identified.extrinsics is not None and state.identified.extrinsics.believed
    ):
        # What was ranged so far was driven by another mount.
        state = state.changed(leg=None, range=extrinsics.distance)
        obeyed = obeyed.changed(leg=None, range=extrinsics.distance)
    leg = way.leg(obeyed, dt)
    state = state.changed(
        distance=way.distance(obeyed, dt, settings),
        leg=leg,
        extrinsics=extrinsics,
        last_linear=state.twist.linear,
        travel=state.motion.travel + driven,
        reversed=state.motion.reversed + way.backward(state, dt),
        period=way.period(state, dt),
        range=way.ranged(obeyed, measurement, leg, dt),
        desired_rate=way.desired_rate(state, measurement, dt),
        curvature=state.identified.curvature.updated(
            previous, measurement, obeyed.twist, dt, drift=settings.curvature_drift
        ),
        slope=_slope(obeyed, measurement, dt),
        dead_band=_dead_band(state, measurement, reading, dt, settings),
        delay=_delay(state, measurement, told or settings),
        rotation_bias=bias,
        measurement=measurement,
        memory=memory,
        map=views,
        odometry=odometry,
        # Another scale is another place: a leg cannot go on from one to the other.
        straight=straight if odometry.trusted is state.identified.odometry.trusted else None,
        trusted_heading=_trusted_heading(state, measurement, settings),
    )
    state = row_of(state, settings).observe(state, measurement, settings)
    if is_close(state, settings):
        state = state.changed(time_in_tolerance=state.settling.time_in_tolerance + dt)
    return with_settled(state, perception, previous, settings)


def _odometry_pose(perception: Perception, settings: ServoSettings) -> Pose | None:
    """Return where the wheels say that the base is; None where nobody says, or shall."""
    observation = perception.observation
    return observation.odometry if settings.odometry and observation is not None else None


def _disproved(perception: Perception, settings: ServoSettings) -> Perception:
    """Return ``perception`` without a geometry that driving disproves, and what led to it."""
    measurement = replace(
        with_difference(perception, settings),
        bearings=None,
        deviation=math.nan,
        covariance=UNKNOWN_COVARIANCE,
        confidence=0.0,
        difference=math.nan,
        reason='the bearings contradict what was driven; they are looked for anew',
    )
    return replace(perception, measurement=measurement, memory=fresh_memory(settings))


def _of_the_axle(measurement: Measurement, extrinsics: Extrinsics) -> Measurement:
    """Return ``measurement`` with the bearings of the axle, where the camera is not on it."""
    mount = extrinsics.mount
    if not mount.any():
        return measurement
    if measurement.offset is not None:
        offset = offset_at_axle(measurement.offset, measurement.heading_error, mount)
        measurement = changed(measurement, offset=offset)
    if measurement.bearings is None:
        return measurement
    bearings = at_axle(measurement.bearings, mount, extrinsics.distance)
    return changed(measurement, bearings=bearings, camera_bearings=measurement.bearings)


def _rotation_bias(state: ServoState, measurement: Measurement) -> float:
    """
    Return what the best rotation is off in heading during a turn in place [rad]; nan if unknown.

    It takes a small baseline for a turn. In place that does not change, so that what bearings show
    of it holds as well for images of a parallax too small for them.
    """
    if not state.phase.turns_in_place:
        return math.nan
    before = state.view.rotation_bias
    if measurement.bearings is None:
        return before
    now = math.remainder(measurement.heading_error - measurement.rotation_heading, 2.0 * math.pi)
    change = math.remainder(now - before, 2.0 * math.pi)
    return now if math.isnan(before) else before + BIAS_SMOOTHING * change


def _without_bias(measurement: Measurement, bias: float) -> Measurement:
    """Return ``measurement`` with the heading of the best rotation, less its ``bias`` if known."""
    if math.isnan(bias):
        return measurement
    heading = math.remainder(measurement.rotation_heading + bias, 2.0 * math.pi)
    return changed(measurement, heading_error=heading)


def _trusted_heading(
    state: ServoState, measurement: Measurement, settings: ServoSettings
) -> float:
    """Return the heading error of the last trusted image by which it drove [rad]."""
    if not state.phase.drives or is_untrusted(measurement, settings):
        return state.view.trusted_heading
    return (
        state.view.trusted_heading if has_turned(state, measurement) else measurement.heading_error
    )


def _slope(state: ServoState, measurement: Measurement, dt: float) -> Slope:
    """
    Return the slope of D, updated by the last command for ``dt`` [s] in step 2.

    A memory of views knows it: of the features that are in view, which come and go.
    """
    if measurement.difference_slope > 0.0:
        return Slope(measurement.difference_slope, state.motion.slope.weight)
    if not state.phase.straight or state.measurement is None:
        return state.motion.slope
    return state.motion.slope.updated(
        measurement.difference - state.measurement.difference, state.twist.linear * dt
    )


def _dead_band(
    state: ServoState,
    measurement: Measurement,
    reading: MapMeasurement | None,
    dt: float,
    settings: ServoSettings,
) -> DeadBand:
    """Return what the base does not follow, by the last command for ``dt`` [s]."""
    if not learns(settings):
        return DeadBand()
    twist = longest_obeyed(state, measurement.stamp_ns, dt, settings)
    return state.identified.dead_band.updated(measurement, reading, twist, dt, settings)


def _delay(state: ServoState, measurement: Measurement, told: ServoSettings) -> Delay:
    """Return how late the base obeys, after one more turn that was seen."""
    if not told.options.anticipation:
        return state.identified.delay
    return state.identified.delay.updated(measurement, state.motion.sent, told)
