"""Events: the measurement of a frame, classified in the phase of the servo."""

from collections.abc import Callable
import math

from visual_servo_epipolar.core.laws.phases.arrival import (
    faces_goal,
    has_parallax,
    is_at_goal,
    is_in_doubt,
    stands_aside,
)
from visual_servo_epipolar.core.laws.phases.bounds import (
    align_bound,
    engage_bound,
    FACING,
    is_matched,
    trial_of,
)
from visual_servo_epipolar.core.laws.phases.conditions import (
    astray,
    escape_bound,
    has_run_up,
    has_turned,
    is_far_enough,
    is_off_course,
    is_sideways,
    is_untrusted,
    leads_away,
    sees_too_little,
)
from visual_servo_epipolar.core.laws.phases.lines import leads_home
from visual_servo_epipolar.core.laws.phases.table import (
    DRIVING,
    ENDED,
    Event,
    next_phase,
    Phase,
)
from visual_servo_epipolar.core.laws.phases.timing import has_timed_out
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

# What the yaw of the camera may be learnt to differ by while a step lasts [rad].
YAW_FOR_NEW_START, YAW_FOR_NEW_ATTEMPT = math.radians(1.5), math.radians(0.5)
DOUBTFUL_LOOKS = 3  # times the frames of who is sure: the noise has to be known
# In a row that must be trusted before the robot moves again; where it is said to have turned
# meanwhile, somebody must have turned it.
RESUMING_FRAMES, TURNED_FRAMES = 3, 15


def classify(state: ServoState, settings: ServoSettings) -> Event:
    """Return the event of ``state.measurement`` in ``state.phase``."""
    measurement, phase = state.measurement, state.phase
    if measurement is None or phase in ENDED:
        return Event.NOTHING
    if has_timed_out(state, measurement, settings):
        return Event.TIMED_OUT
    if state.motion.trouble:
        return _disobeyed(state)
    if sees_too_little(measurement, settings):
        return Event.LOST if phase in DRIVING else Event.NOTHING
    if astray(state, measurement, settings):
        return Event.ASTRAY
    event = _CLASSIFIERS[phase](state, measurement, settings)
    into_step_2 = next_phase(phase, event) is Phase.MATCHING_FEATURES
    return Event.LOST if into_step_2 and not math.isfinite(measurement.difference) else event


def _disobeyed(state: ServoState) -> Event:
    """Return the event of a motion that contradicts the commands: hold, or end where it recurs."""
    if state.phase not in DRIVING:
        return Event.NOTHING
    return Event.DISOBEYED if state.motion.is_final else Event.LOST


def _survey(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    """Return the event that begins a run, or resumes it after the tracks came back."""
    if not math.isfinite(measurement.difference):
        return Event.LOST
    if is_at_goal(state, measurement, settings):
        return Event.MATCHED
    if measurement.bearings is None:
        return Event.NO_BASELINE if measurement.parallax <= settings.near_parallax else Event.LOST
    if is_sideways(measurement, settings):
        return Event.SIDEWAYS
    aligned = abs(measurement.bearings.chi) <= engage_bound(measurement, settings)
    if aligned and abs(measurement.bearings.alpha) <= align_bound(measurement, settings):
        return Event.ALIGNED
    return Event.APART


def _holding(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    # Where images are false, a single one may look right.
    if state.settled < (TURNED_FRAMES if has_turned(state, measurement) else RESUMING_FRAMES):
        return Event.NOTHING
    return _survey(state, measurement, settings)


def _orienting(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    if state.settled < settings.align_frames:
        return Event.NOTHING
    if is_at_goal(state, measurement, settings):
        return Event.MATCHED
    if is_sideways(measurement, settings):
        return Event.SIDEWAYS
    if measurement.bearings is not None:
        return _begun(measurement, settings, Event.APART)
    # At the goal's heading and still no baseline: step 2 removes the residual.
    return Event.ALIGNED


def _retreating(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    if is_untrusted(measurement, settings):
        return Event.LOST
    if not has_run_up(state, measurement, settings):
        return Event.NOTHING
    if leads_home(measurement, settings):
        return Event.ALIGNED
    if measurement.bearings is None or not is_far_enough(measurement, settings):
        return Event.NOTHING
    within = abs(measurement.bearings.chi) <= settings.retreat_bearing
    return Event.APART if within and not is_sideways(measurement, settings) else Event.NOTHING


def _displacing(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    if measurement.bearings is None:
        return Event.LOST
    alpha = measurement.bearings.alpha
    if abs(measurement.bearings.chi) <= engage_bound(measurement, settings):
        return Event.DISPLACED  # e_du is zero already: any e_au will do
    if not settings.options.discordant_turn and not settings.derives:
        return Event.DISPLACED if abs(alpha) > settings.singular_epipole else Event.NOTHING
    near = abs(alpha - math.atan(state.target)) <= settings.displacement_tolerance
    return Event.DISPLACED if near else Event.NOTHING


def _zeroing(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    if measurement.bearings is None:
        return Event.NO_BASELINE if measurement.parallax <= settings.near_parallax else Event.LOST
    chi = measurement.bearings.chi
    if abs(chi) >= settings.divergence:
        return Event.DIVERGED
    if state.yaw_learnt > YAW_FOR_NEW_START:
        return _begun(measurement, settings, Event.ESCAPED)
    if not state.latched and is_off_course(measurement, settings):
        return Event.ALIGNED if leads_home(measurement, settings) else Event.SIDEWAYS
    if state.latched and abs(chi) > escape_bound(state, measurement, settings):
        return _begun(measurement, settings, Event.ESCAPED)
    if not state.latched and leads_away(measurement, settings):
        return _begun(measurement, settings, Event.ESCAPED)
    return Event.ALIGNED if state.settled >= settings.align_frames else Event.NOTHING


def _begun(measurement: Measurement, settings: ServoSettings, event: Event) -> Event:
    """Return the ``event`` that begins step 1; but from too near a goal the robot backs off."""
    near = not is_far_enough(measurement, settings)
    return Event.SIDEWAYS if near and settings.options.retreat else event


def _matching(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    if is_untrusted(measurement, settings):
        return Event.LOST
    if state.settled < _looks(state, measurement, settings) * settings.arrival_frames:
        return Event.NOTHING
    attempts_remain = state.attempts < settings.max_attempts
    repeats = settings.options.new_attempts and attempts_remain
    missed = Event.MISSED if repeats else Event.EXHAUSTED
    if has_parallax(state, measurement, settings):
        # Within a tolerance of the owner's alone it is no miss: it goes on, nearer.
        return missed if is_matched(measurement, settings, trial_of(state)) else Event.NOTHING
    if repeats and measurement.offset is None and state.yaw_learnt > YAW_FOR_NEW_ATTEMPT:
        return Event.MISSED  # aside by as much as two views cannot tell
    if faces_goal(state, measurement, settings):
        return Event.MATCHED
    if settings.options.final_turn:
        return Event.TURNED
    return missed if settings.arrival_heading > FACING else Event.MATCHED


def _looks(state: ServoState, measurement: Measurement, settings: ServoSettings) -> int:
    """Return how many times the usual frames decide whether this is the goal."""
    if not is_in_doubt(measurement, settings) or stands_aside(state, measurement, settings):
        return 1
    return DOUBTFUL_LOOKS


def _nothing(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Event:
    return Event.NOTHING


_CLASSIFIERS: dict[Phase, Callable[[ServoState, Measurement, ServoSettings], Event]] = {
    Phase.WAITING: _survey,
    Phase.HOLDING: _holding,
    Phase.ORIENTING: _orienting,
    Phase.RETREATING: _retreating,
    Phase.DISPLACING: _displacing,
    Phase.ZEROING_EPIPOLES: _zeroing,
    Phase.MATCHING_FEATURES: _matching,
    Phase.ARRIVED: _nothing,
    Phase.FAILED: _nothing,
}
