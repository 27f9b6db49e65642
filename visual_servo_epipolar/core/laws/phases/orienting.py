"""Orienting: the turn in place to the heading of the photograph."""

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.braking import settled_turn
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.arrival import faces_goal, is_at_goal
from visual_servo_epipolar.core.laws.phases.bounds import pulse_turn_bound, trial_of
from visual_servo_epipolar.core.laws.phases.conditions import begun_step_1, is_sideways
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.perception.measurement import Measurement


def _classify(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    if state.settling.settled < settings.align_frames:
        return Event.NOTHING
    if is_at_goal(state, measurement, settings):
        return Event.MATCHED
    if is_sideways(measurement, settings):
        return Event.SIDEWAYS
    if measurement.bearings is not None:
        return begun_step_1(measurement, settings, Event.APART)
    # At the goal's heading and still no baseline: step 2 removes the residual.
    return Event.ALIGNED


def _command(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    """Return the turn in place to the goal's heading."""
    return Twist(0.0, settled_turn(-measurement.heading_error, state, settings))


def _is_close(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    bound = pulse_turn_bound(measurement, settings, trial_of(state))
    return abs(measurement.heading_error) <= bound


ORIENTING = PhaseRow(
    phase=Phase.ORIENTING,
    words='turns in place to the heading of the photograph',
    colour='#CC79A7',
    classify=_classify,
    command=_command,
    is_settled=faces_goal,
    is_close=_is_close,
)
