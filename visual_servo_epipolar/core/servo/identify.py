"""Identify: camera, base and wheels by one image, and the measurement corrected for them."""

from dataclasses import replace
import math

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics
from visual_servo_epipolar.core.estimate.extrinsics_update import update_extrinsics
from visual_servo_epipolar.core.estimate.straight_leg import straight_on
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle, offset_at_axle
from visual_servo_epipolar.core.servo.dead_reckoning import DrivenInterval
from visual_servo_epipolar.core.servo.fuse import disproved, Fusion
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import Identification, ServoState

BIAS_SMOOTHING = 0.2  # weight of the newest value in an exponential mean
MANY_RESTARTS = 4  # of step 1: something is wrong, as after an attempt that missed


def identify(
    state: ServoState,
    perception: Perception,
    fusion: Fusion,
    drive: DrivenInterval,
    settings: ServoSettings,
) -> tuple[Fusion, Identification]:
    """Return what a ``drive`` and the view after it show, less a disproved geometry."""
    before, acted, slope = state.identified, drive.acted, state.motion.slope.value
    extrinsics = update_extrinsics(
        before.extrinsics or settings.extrinsics,
        fusion.measurement,
        drive.travel,
        missed=state.run.attempts > 1 or state.run.restarts >= MANY_RESTARTS,
    )
    if extrinsics.contradicts:
        fusion, extrinsics = disproved(perception, settings), settings.extrinsics
    straight = None
    if state.phase.straight:
        leg = before.straight, fusion.reading, drive.travel
        straight, extrinsics = straight_on(*leg, extrinsics)
    measurement = _of_the_axle(fusion.measurement, extrinsics)
    odometry, bias = drive.odometry.judge(measurement), _rotation_bias(state, measurement)
    measurement = _without_bias(measurement, bias)
    fusion = fusion._replace(measurement=measurement, rotation_bias=bias)
    moved = fusion.reading, acted.longest, acted.dt
    band = before.dead_band.updated(measurement, *moved, settings, slope)
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
        # Another scale is another place: a leg cannot go on from one to the other.
        straight=straight if odometry.trusted is before.odometry.trusted else None,
    )


def _of_the_axle(measurement: Measurement, extrinsics: Extrinsics) -> Measurement:
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
