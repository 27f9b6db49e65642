"""
Law ``smooth``: one motion to the goal, its phase APPROACHING, and where that cannot begin or end.

A robot beside the goal backs off first, on an arc. What two views alone know ends the run as in
the paper's second step: a memory of views is what carries one motion through to its end.
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.braking import TAIL_S
from visual_servo_epipolar.core.laws.machine import Classifier, PhaseRow, StateMachine
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.arrival import has_parallax, is_near_enough
from visual_servo_epipolar.core.laws.phases.bounds import (
    ends_by_pulses,
    FACING,
    facing_bound,
    matched_bound,
    Trial,
    trial_of,
)
from visual_servo_epipolar.core.laws.phases.conditions import (
    is_behind,
    is_far_enough,
    is_untrusted,
    with_new_leg,
)
from visual_servo_epipolar.core.laws.phases.standing import (
    ARRIVED,
    FAILED,
    has_run_up,
    HOLDING,
    ORIENTING,
    RETREATING,
    WAITING,
)
from visual_servo_epipolar.core.laws.smooth.approach import approach, back_off, way_left
from visual_servo_epipolar.core.laws.smooth.steering import (
    goes_around,
    goes_around_in_view,
    KEPT_SHARE,
    leads_around,
    LEAST_SHARE,
    polar_pose,
    sees_all_round,
)
from visual_servo_epipolar.core.laws.state import ServoState
from visual_servo_epipolar.core.laws.two_steps.two_steps import MATCHING_FEATURES, transitions_by
from visual_servo_epipolar.core.perception.measurement import Measurement

NEAR_GOAL = 0.25  # from where a bearing tells of the goal, not of the way to it [m]
PASSED = 0.05  # beyond which the goal was passed by [m]
HANDOVER_DIFFERENCE = 0.03  # |D| at which two views end as the second step does
LINED_UP = 0.2  # bearings up to which D is that of the way ahead [rad]
BESIDE, HYSTERESIS = 0.05, 0.35  # beyond it, where a robot backs off: at first, on its way [rad]


def approaching(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event of one motion: lost, beside, missed, or at its end."""
    if is_untrusted(measurement, settings):
        return Event.LOST
    if measurement.offset is None:
        # A single view without the memory is none; near the goal two views know no direction.
        if measurement.bearings is None or _is_lined_up(measurement, measurement.bearings):
            return Event.ALIGNED
        return Event.SIDEWAYS if _lies_beside(measurement, settings) else Event.NOTHING
    if state.settling.settled >= settings.arrival_frames:
        if has_parallax(state, measurement, settings):
            return missed(state, settings)
        bound = facing_bound(measurement, settings, trial_of(state, spent=True))
        turned = abs(measurement.heading_error) > bound
        pulses = ends_by_pulses(measurement, settings)
        return Event.TURNED if turned and pulses else Event.MATCHED
    x, y = measurement.offset
    pose = polar_pose(x, y, measurement.heading_error)
    all_round = goes_around(x, y, measurement.heading_error, measurement)
    if all_round or goes_around_in_view(pose, measurement, settings):
        return Event.NOTHING
    if not state.settling.settled and y > -PASSED and max(y, abs(x)) > PASSED:
        return missed(state, settings)
    beside = y < -NEAR_GOAL and _lies_beside(measurement, settings)
    return Event.SIDEWAYS if beside else Event.NOTHING


def _is_lined_up(measurement: Measurement, bearings: Bearings) -> bool:
    """Return whether the second step leads to the goal: near it, where D is small, on its axis."""
    near = abs(measurement.difference) <= HANDOVER_DIFFERENCE
    return near and max(abs(bearings.chi), abs(bearings.alpha)) <= LINED_UP


def _lies_beside(
    measurement: Measurement,
    settings: DriveSettings,
    *,
    beyond: float = HYSTERESIS,
    least: float = KEPT_SHARE,
) -> bool:
    """
    Return whether the goal lies beside, ``beyond`` [rad] of where a robot backs off to.

    It does not where a wide view leads around it with the ``least`` share of the distance left.
    """
    bearings = measurement.bearings
    if bearings is None or not settings.options.retreat or sees_all_round(measurement):
        return False
    pose = polar_pose(math.cos(bearings.psi), math.sin(bearings.psi), bearings.heading_error)
    if leads_around(pose, measurement, settings, least=least):
        return False
    return not is_behind(bearings) or abs(bearings.chi) > settings.sideways_bearing + beyond


def missed(state: ServoState, settings: DriveSettings) -> Event:
    """Return the event of a miss: a new attempt backs off first, as far as that is allowed."""
    repeats = settings.options.new_attempts and settings.options.retreat
    again = repeats and state.run.attempts < settings.max_attempts
    return Event.MISSED if again else Event.EXHAUSTED


def _ends(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    """
    Return whether the motion ends here, along the axis and in heading; a memory knows both.

    A base with a dead band turns by pulses, in place, which end finer than those on the way.
    """
    if measurement.offset is None:
        return False
    trial = motion_trial(state)
    rest = 1.0 / _decay(state, settings, trial)
    turned = abs(measurement.heading_error) > rest * _heading_bound(measurement, settings, trial)
    stands = state.settling.rest is not None and ends_by_pulses(measurement, settings)
    if turned and not stands:
        return False
    through = is_through(state, measurement, settings, trial, rest=rest)
    return through or is_near_enough(state, measurement, settings)


def _decay(state: ServoState, settings: DriveSettings, trial: Trial) -> float:
    """
    Return the share of what is left now that is left when the last frame has settled.

    It decays with TAIL_S, so that who is on the way to the end need not be there to settle: each
    frame asks for less, the last one for nothing beyond the bounds. A base with a dead band stops
    where it is.
    """
    if max(settings.dead_band_linear, settings.dead_band_angular) > 0.0:
        return 1.0
    frames = max(settings.arrival_frames - 1 - state.settling.settled, 0)
    return math.exp(-frames * trial.frame_s / TAIL_S)


def _heading_bound(measurement: Measurement, settings: DriveSettings, trial: Trial) -> float:
    """Return the largest heading error [rad] that counts as zero: that which is not known."""
    known = min(measurement.heading_deviation, FACING, settings.arrival_heading)
    return max(facing_bound(measurement, settings, trial), known)


def is_through(
    state: ServoState,
    measurement: Measurement,
    settings: DriveSettings,
    trial: Trial,
    *,
    rest: float = 1.0,
) -> bool:
    """
    Return whether the motion leads no farther: D is zero, or the way that is left.

    Aside of the goal they are not zero at one place, and the motion stands where the way ends.
    """
    bound = rest * matched_bound(measurement, settings, trial)
    left = abs(way_left(measurement, state)) * measurement.difference_slope
    return min(abs(measurement.difference), left) <= bound


def motion_trial(state: ServoState) -> Trial:
    """Return how long the robot has tried: what is closer than usual it tries for less long."""
    return trial_of(state)._replace(is_brief=True)


def is_close(state: ServoState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the motion leads no farther, within the usual bounds."""
    known = measurement.offset is not None
    return known and is_through(state, measurement, settings, trial_of(state, spent=True))


def retreating(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
    """Return the event of backing off: whether the goal lies ahead by now."""
    if is_untrusted(measurement, settings):
        return Event.LOST
    has_room = has_run_up(state, measurement, settings) and is_far_enough(measurement, settings)
    if measurement.bearings is None or not has_room:
        return Event.NOTHING
    return (
        Event.NOTHING
        if _lies_beside(measurement, settings, beyond=0.0, least=1.0)
        else Event.APART
    )


def _retreat(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Twist:
    return STANDSTILL if settings.max_retreat == 0.0 else back_off(state, measurement, settings)


def surveyed(row: PhaseRow) -> PhaseRow:
    """Return the row of a robot that stands: one motion begins wherever the goal is known."""

    def classify(state: ServoState, measurement: Measurement, settings: DriveSettings) -> Event:
        event = row.classify(state, measurement, settings)
        if event is Event.SIDEWAYS and not _lies_beside(
            measurement, settings, beyond=BESIDE, least=LEAST_SHARE
        ):
            event = Event.APART
        known = measurement.offset is not None or measurement.bearings is not None
        return Event.APART if known and event in (Event.ALIGNED, Event.NO_BASELINE) else event

    survey: Classifier = classify
    return replace(row, classify=survey)


APPROACHING = PhaseRow(
    phase=Phase('approaching', drives=True, closes_in=True, ranges=True, straight=True),
    words='drives to the goal in one motion',
    colour='#117733',
    classify=approaching,
    command=approach,
    is_settled=_ends,
    is_close=is_close,
    begin=lambda state, measurement, _: with_new_leg(state, measurement),
)
ONE_MOTION = StateMachine(
    (
        *(surveyed(WAITING), surveyed(HOLDING), ARRIVED, FAILED, ORIENTING, MATCHING_FEATURES),
        replace(RETREATING, classify=retreating, command=_retreat),
        APPROACHING,
    ),
    {
        **transitions_by(APPROACHING.phase),
        (APPROACHING.phase, Event.SIDEWAYS): Phase.RETREATING,
        (APPROACHING.phase, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (APPROACHING.phase, Event.MATCHED): Phase.ARRIVED,
        (APPROACHING.phase, Event.MISSED): Phase.RETREATING,
        (APPROACHING.phase, Event.TURNED): Phase.ORIENTING,
    },
)
