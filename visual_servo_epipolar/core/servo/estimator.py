"""
Estimator: what one perception makes of goal, camera and base, in order.

What was driven since the last image; the fusion of two views with the map of keyframes, which
knows better near the goal; what driving shows of camera mount, base and wheels, and the bearings
of the axle that lead to; dead reckoning; then the estimate of the goal, one value. The map learns
after the twist.
"""

from dataclasses import replace
import math
from typing import NamedTuple

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.estimate.extrinsics import (
    Extrinsics,
    update_extrinsics,
    with_driven_yaw,
)
from visual_servo_epipolar.core.estimate.goal_estimate import goal_estimate, MotionState
from visual_servo_epipolar.core.estimate.map_state import localize, MapState, measurement_of
from visual_servo_epipolar.core.laws.conditions import turned_by_far
from visual_servo_epipolar.core.laws.two_steps import MOST_RESTARTS
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.odometry.increments import OdometryIncrement
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle, offset_at_axle
from visual_servo_epipolar.core.servo import dead_reckoning
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import Identification, ServoState, ViewState
from visual_servo_epipolar.core.twoview.estimator import UNKNOWN_COVARIANCE
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive, Perception, with_difference
from visual_servo_epipolar.core.twoview.rivals import ahead_of_both, begun, followed, in_order
from visual_servo_epipolar.core.twoview.validation import noise_learnt

SKIPPED = 3  # views between two that are estimated all the same: noise and attitude may change
BIAS_SMOOTHING = 0.2  # weight of the newest value in an exponential mean


class Fusion(NamedTuple):
    """
    What two views and the map make of an image together.

    ``reading`` is what the ``map`` measures, None if nothing; ``memory`` what perception carries
    on, ``rotation_bias`` what the best rotation is off in heading [rad], nan while unknown.
    """

    measurement: Measurement
    memory: PerceptionMemory
    map: MapState
    reading: MapLocalization | None = None
    rotation_bias: float = math.nan


def estimate(
    state: ServoState, perception: Perception, dt: float, settings: ServoSettings
) -> ServoState:
    """Return the state by a ``perception``, with the estimate of the goal after it."""
    drive = dead_reckoning.drive_since(state, perception, dt, settings)
    fusion = fuse(state, perception, drive.increment, dt, settings)
    fusion, identified = identify(state, perception, fusion, drive, settings)
    measurement = fusion.measurement
    leg, motion = dead_reckoning.reckon(state, measurement, identified, drive, settings)
    return state.changed(
        view=_see(state, fusion, identified, motion, perception.observation, dt, settings),
        goal=replace(state.goal, map=fusion.map),
        identified=identified,
        motion=motion,
        leg=leg,
        travel=state.run.travel + drive.travel,
        desired_rate=dead_reckoning.desired_rate(state, measurement, dt),
    )


def _see(
    state: ServoState,
    fusion: Fusion,
    identified: Identification,
    motion: MotionState,
    observation: Observation | None,
    dt: float,
    settings: ServoSettings,
) -> ViewState:
    """Return what is seen, with what perception and the map carry on."""
    mounted = identified.extrinsics or settings.extrinsics
    stamp_ns, before = fusion.measurement.stamp_ns, state.view.seen_ns
    enough = fusion.measurement.features >= settings.min_features
    period = dead_reckoning.usual_period(state.view.period, dt)
    return ViewState(
        measurement=goal_estimate(
            fusion.measurement,
            fusion.reading,
            mounted,
            identified.base,
            place=fusion.map.place,
            motion=motion,
            period=period,
            jitter=dead_reckoning.jitter(state.view, dt),
            trusted_heading=_trusted_heading(state, fusion.measurement, settings),
            followed=fusion.memory.rivals,
        ),
        memory=fusion.memory,
        period=period,
        rotation_bias=fusion.rotation_bias,
        frame=state.view.frame,
        # The last image with enough features; the first one, if none ever had.
        seen_ns=stamp_ns if enough or before is None else before,
        joints=None if observation is None else observation.joints,
    )


def _trusted_heading(
    state: ServoState, measurement: Measurement, settings: ServoSettings
) -> float:
    """Return the heading error of the last trusted image by which it drove [rad]."""
    before = math.nan if state.measurement is None else state.measurement.trusted_heading
    trusted = state.phase.drives and not measurement.is_untrusted(settings.near_parallax)
    if trusted and not turned_by_far(measurement.heading_error, before):
        return measurement.heading_error
    return before


def update_map(state: ServoState) -> ServoState:
    """Return the state after what no command waits for."""
    views, memory = state.map.update_map(), state.view.memory
    if memory is not None:
        memory = noise_learnt(memory)
        if views is not state.map and memory.wrong is not None and views.views is not None:
            memory = replace(memory, wrong=views.views.wrong)
    if views is state.map and memory is state.view.memory:
        return state
    return state.changed(goal=replace(state.goal, map=views), memory=memory)


def fuse(
    state: ServoState,
    perception: Perception,
    increment: OdometryIncrement,
    dt: float,
    settings: ServoSettings,
) -> Fusion:
    """Return what two views, by ``perception``, and the map know ``dt`` [s] after the last."""
    seconds = dt if state.phase.runs else 0.0
    after, reading = localize(
        state.map,
        perception,
        increment,
        settings,
        dt=seconds,
        encoder_noise=state.check.head.noise,
    )
    measurement = measurement_of(perception, reading, after, settings)
    memory, seen = perception.memory, perception.observation
    needed = measurement.bearings is None and not measurement.parallax <= settings.near_parallax
    if needed and memory.two_view_skip and seen is not None:  # the estimate that was skipped
        memory = replace(memory, two_view_skip=0, wrong=None)
        perception = perceive(seen, settings, state.view.frame, memory)
        measurement = measurement_of(perception, reading, after, settings)
    memory = two_view_skip(perception.memory, measurement, reading, after)
    memory = _with_rivals(memory, measurement, seen, state, increment.motion.way, settings)
    return Fusion(measurement, memory, after, reading)


def _with_rivals(
    memory: PerceptionMemory,
    measurement: Measurement,
    seen: Observation | None,
    state: ServoState,
    way: float,
    settings: ServoSettings,
) -> PerceptionMemory:
    """Return what perception carries on of two geometries that fit: one, once the way tells."""
    before = memory.rivals
    if not measurement.rivals or seen is None or not state.phase.drives:
        return memory if before is None else replace(memory, rivals=None)
    if before is None:
        before = begun(measurement.rivals, measurement.rotation_heading)
    ordered = in_order(measurement.rivals, before)
    extrinsics = state.identified.extrinsics or settings.extrinsics
    rivals = followed(before, ordered, seen, way, extrinsics.mount)
    if rivals.decided is None:
        return replace(memory, rivals=rivals)
    bearings = ahead_of_both(ordered[rivals.decided], seen)
    return replace(memory, rivals=None, decided=True, bearings=bearings, consecutive_rejections=0)


def disproved(perception: Perception, settings: ServoSettings) -> Fusion:
    """Return a fusion without a geometry that driving disproves, and what led to it."""
    measurement = replace(
        with_difference(perception, settings),
        bearings=None,
        deviation=math.nan,
        covariance=UNKNOWN_COVARIANCE,
        confidence=0.0,
        difference=math.nan,
        reason=Reason.DISPROVED.of(),
    )
    memory = replace(fresh_memory(settings), shutter=perception.memory.shutter)
    return Fusion(measurement, memory, MapState())


def two_view_skip(
    memory: PerceptionMemory,
    measurement: Measurement,
    reading: MapLocalization | None,
    after: MapState,
) -> PerceptionMemory:
    """Return what perception carries on, after a ``measurement`` that may be by a ``reading``."""
    by_two = measurement.bearings is not None and not measurement.remembered
    if reading is None or by_two or after.views is None:
        known = memory.two_view_skip or memory.wrong is not None
        return replace(memory, two_view_skip=0, wrong=None) if known else memory
    return replace(
        memory,
        bearings=reading.bearings if measurement.remembered else memory.bearings,
        two_view_skip=memory.two_view_skip - 1 if memory.two_view_skip else SKIPPED,
        wrong=after.views.wrong,
    )


def identify(
    state: ServoState,
    perception: Perception,
    fusion: Fusion,
    drive: dead_reckoning.DrivenInterval,
    settings: ServoSettings,
) -> tuple[Fusion, Identification]:
    """Return what a ``drive`` and the view after it show, less a disproved geometry."""
    before, acted, slope = state.identified, drive.acted, state.motion.slope.value
    missed = state.run.attempts > 1 or state.run.restarts >= MOST_RESTARTS // 3
    known = before.extrinsics or settings.extrinsics
    extrinsics = update_extrinsics(known, fusion.measurement, drive.travel, missed=missed)
    if extrinsics.contradicts:
        fusion, extrinsics = disproved(perception, settings), settings.extrinsics
    views = fusion.map.views
    if views is not None and views.geometry is not None:
        extrinsics = with_driven_yaw(extrinsics, views.geometry, missed=missed)
    measurement = of_the_axle(fusion.measurement, extrinsics)
    odometry, bias = drive.odometry.judge(measurement), _rotation_bias(state, measurement)
    measurement = _without_bias(measurement, bias)
    fusion = fusion._replace(measurement=measurement, rotation_bias=bias)
    moved = fusion.reading, acted.longest, acted.dt
    band = before.dead_band.updated(measurement, *moved, settings, slope, state.check.view_moves)
    # Turns that a dead band swallowed looked like a curvature.
    misled = band.angular.value > before.dead_band.angular.value
    curvature = Curvature() if misled else before.curvature
    return fusion, Identification(
        extrinsics=extrinsics,
        curvature=curvature.updated(
            state.measurement, measurement, acted.twist, acted.dt, drift=settings.curvature_drift
        ),
        dead_band=band,
        delay=before.delay.updated(measurement, state.motion.sent, settings),
        odometry=odometry,
    )


def of_the_axle(measurement: Measurement, extrinsics: Extrinsics) -> Measurement:
    """Return ``measurement`` with the bearings of the axle, where the camera is not on it."""
    mount = extrinsics.mount
    if not mount.any():
        return measurement
    if measurement.offset is not None:
        offset = offset_at_axle(measurement.offset, measurement.heading_error, mount)
        measurement = replace(measurement, offset=offset)
    if measurement.bearings is None:
        return measurement
    bearings = at_axle(measurement.bearings, mount, extrinsics.distance)
    return replace(measurement, bearings=bearings, camera_bearings=measurement.bearings)


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
    return replace(measurement, heading_error=heading)
