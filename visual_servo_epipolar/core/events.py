"""What an observation means: the thresholds between sight and state machine."""

from collections.abc import Callable
import math

from visual_servo_epipolar.core.epipolar import Bearings
from visual_servo_epipolar.core.perception import Sight
from visual_servo_epipolar.core.phases import DRIVING, ENDED, Event, Phase
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.servo_state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between

ENGAGE_DEVIATIONS, RELEASE_DEVIATIONS = 1.0, 4.0


def bearing_current(bearings: Bearings) -> float:
    """Return atan(e_au / f), the direction of the current epipole, in [-pi/2, pi/2]."""
    return math.atan(bearings.epipole_current)


def bearing_desired(bearings: Bearings) -> float:
    """Return atan(e_du / f), the direction of the desired epipole, in [-pi/2, pi/2]."""
    return math.atan(bearings.epipole_desired)


def engage_bound(sight: Sight, settings: ServoSettings) -> float:
    """Return the bearing of e_du [rad] that counts as zero: it cannot be less than its noise."""
    return max(settings.latch_engage, ENGAGE_DEVIATIONS * _deviation(sight))


def release_bound(sight: Sight, settings: ServoSettings) -> float:
    """Return the bearing of e_du [rad] that has left zero, and not by noise alone."""
    return max(settings.latch_release, RELEASE_DEVIATIONS * _deviation(sight))


def _deviation(sight: Sight) -> float:
    return 0.0 if math.isnan(sight.deviation) else sight.deviation


def is_sideways(bearings: Bearings, settings: ServoSettings) -> bool:
    """Return whether the goal lies beside or behind, where law full backs off first."""
    if settings.law != 'full':
        return False
    return bearings.sigma > 0.0 or abs(bearing_desired(bearings)) > settings.sideways_bearing


def classify(state: ServoState, settings: ServoSettings) -> Event:
    """Return what ``state.sight`` means in ``state.phase``."""
    sight, phase = state.sight, state.phase
    if sight is None or phase in ENDED:
        return Event.NOTHING
    elapsed = seconds_between(state.phase_start_ns, sight.stamp_ns)
    running = phase in DRIVING or phase is Phase.HOLDING
    run = seconds_between(state.run_start_ns, sight.stamp_ns)
    if running and run > settings.run_timeout:
        return Event.TIMED_OUT
    if phase is Phase.HOLDING and elapsed > settings.holding_timeout:
        return Event.TIMED_OUT
    if phase in DRIVING and elapsed > settings.phase_timeout:
        return Event.TIMED_OUT
    if sight.features < settings.min_features:
        return Event.LOST if phase in DRIVING else Event.NOTHING
    return _CLASSIFIERS[phase](state, sight, settings)


def is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame fulfils the aim of the phase."""
    sight = state.sight
    if sight is None or sight.features < settings.min_features:
        return False
    if state.phase is Phase.ORIENTING:
        return abs(sight.heading_error) <= settings.align_tolerance
    if state.phase is Phase.MATCHING_FEATURES:
        return abs(sight.difference) <= settings.arrival_difference
    if state.phase is Phase.ZEROING_EPIPOLES and state.latched and sight.bearings is not None:
        return abs(bearing_current(sight.bearings)) <= settings.align_tolerance
    return False


def _survey(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    """Decide how to begin, or to begin again after the tracks came back."""
    if sight.feature_error <= settings.goal_error:
        return Event.MATCHED
    if sight.bearings is None:
        return Event.NO_BASELINE if sight.parallax <= settings.near_parallax else Event.LOST
    if is_sideways(sight.bearings, settings):
        return Event.SIDEWAYS
    aligned = abs(bearing_desired(sight.bearings)) <= engage_bound(sight, settings)
    if aligned and abs(bearing_current(sight.bearings)) <= settings.align_tolerance:
        return Event.ALIGNED
    return Event.APART


def _orienting(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if state.settled < settings.align_frames:
        return Event.NOTHING
    if sight.feature_error <= settings.goal_error:
        return Event.MATCHED
    if sight.bearings is not None and is_sideways(sight.bearings, settings):
        return Event.SIDEWAYS
    if sight.bearings is not None:
        return Event.APART
    # Turned to the goal's heading and still no baseline: what is left is removed by step 2.
    return Event.ALIGNED


def _is_astray(sight: Sight, settings: ServoSettings) -> bool:
    """Return whether the goal is not near, and where it is cannot be trusted."""
    return sight.bearings is None and sight.parallax > settings.near_parallax


def _retreating(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if _is_astray(sight, settings):
        return Event.LOST
    if sight.bearings is None or sight.difference > -settings.retreat_difference:
        return Event.NOTHING
    ahead = sight.bearings.sigma < 0.0
    inside = abs(bearing_desired(sight.bearings)) <= settings.retreat_bearing
    return Event.APART if ahead and inside else Event.NOTHING


def _displacing(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if sight.bearings is None:
        return Event.LOST
    bearing = bearing_current(sight.bearings)
    if abs(bearing_desired(sight.bearings)) <= engage_bound(sight, settings):
        return Event.DISPLACED  # e_du is zero already: no need for e_au to be anywhere
    if settings.law != 'full':
        return Event.DISPLACED if abs(bearing) > settings.singular_epipole else Event.NOTHING
    near = abs(bearing - math.atan(state.target)) <= settings.displacement_tolerance
    return Event.DISPLACED if near else Event.NOTHING


def _zeroing(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if sight.bearings is None:
        return Event.NO_BASELINE if sight.parallax <= settings.near_parallax else Event.LOST
    bearing = bearing_desired(sight.bearings)
    if abs(bearing) >= settings.divergence:
        return Event.DIVERGED
    if not state.latched and is_sideways(sight.bearings, settings):
        return Event.SIDEWAYS
    if state.latched and abs(bearing) > release_bound(sight, settings):
        return Event.ESCAPED
    return Event.ALIGNED if state.settled >= settings.align_frames else Event.NOTHING


def _matching(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if _is_astray(sight, settings):
        return Event.LOST
    if state.settled < settings.arrival_frames:
        return Event.NOTHING
    near = sight.feature_error <= settings.arrival_error
    if near and sight.parallax <= settings.arrival_parallax:
        return Event.MATCHED
    return Event.MISSED if state.attempts < settings.max_attempts else Event.EXHAUSTED


def _nothing(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    return Event.NOTHING


_CLASSIFIERS: dict[Phase, Callable[[ServoState, Sight, ServoSettings], Event]] = {
    Phase.WAITING: _survey,
    Phase.HOLDING: _survey,
    Phase.ORIENTING: _orienting,
    Phase.RETREATING: _retreating,
    Phase.DISPLACING: _displacing,
    Phase.ZEROING_EPIPOLES: _zeroing,
    Phase.MATCHING_FEATURES: _matching,
    Phase.ARRIVED: _nothing,
    Phase.FAILED: _nothing,
}
