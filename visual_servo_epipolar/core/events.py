"""What an observation means: the thresholds between sight and state machine."""

from collections.abc import Callable
import math

from visual_servo_epipolar.core import laws
from visual_servo_epipolar.core.epipolar import Bearings
from visual_servo_epipolar.core.perception import Sight
from visual_servo_epipolar.core.phases import DRIVING, ENDED, Event, Phase
from visual_servo_epipolar.core.ranging import look_ahead, UNKNOWN_RANGE
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.servo_state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between

ENGAGE_DEVIATIONS, RELEASE_DEVIATIONS, NOISE_DEVIATIONS = 1.0, 4.0, 2.0
RESIDUAL = 1.25  # parallax of a standstill, in deviations of the noise: see ``fit_rotation``
FOLLOWED = 1e-3  # offset that line following may leave [m]
LARGEST_ESCAPE = 0.1  # [rad]
FRAME_S = 0.1  # the shortest turn: one command, at the usual frame rate [s]


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


def escape_bound(state: ServoState, sight: Sight, settings: ServoSettings) -> float:
    """
    Return the bearing of e_du [rad] at which step 1 has to begin anew.

    Line following shrinks an offset x by exp(0.9 d / L) on the way d that is left: what it brings
    below a millimetre need not be zeroed first, as when a camera ahead of the axle swings aside
    while the robot turns.
    """
    bound = release_bound(sight, settings)
    if settings.law != 'full' or not settings.line_following:
        return bound
    way = state.range if state.range > 0.0 else min(state.distance, UNKNOWN_RANGE)
    follows = min(0.9 * way / look_ahead(way, settings.look_ahead), 9.0)
    return max(bound, min(FOLLOWED * math.exp(follows) / way, LARGEST_ESCAPE))


def align_bound(sight: Sight, settings: ServoSettings) -> float:
    """Return the bearing of e_au [rad] that counts as zero: it cannot be less than its noise."""
    return max(settings.align_tolerance, ENGAGE_DEVIATIONS * _deviation(sight))


def _deviation(sight: Sight) -> float:
    return 0.0 if math.isnan(sight.deviation) else sight.deviation


def is_sideways(sight: Sight, settings: ServoSettings) -> bool:
    """
    Return whether law full backs off before step 1.

    So it does from beside or past the goal, and where the field of view leaves no room for a turn
    that would bring the robot onto the axis before it is at the goal.
    """
    bearings = sight.bearings
    if settings.law != 'full' or bearings is None:
        return False
    if not is_behind(bearings) or abs(bearing_desired(bearings)) > settings.sideways_bearing:
        return True
    return displacement(sight, settings) is None


def _is_off_course(sight: Sight, settings: ServoSettings) -> bool:
    """Return whether step 1, once begun, had better be given up: later than it would not begin."""
    bearings = sight.bearings
    if settings.law != 'full' or bearings is None:
        return False
    if not is_behind(bearings) or abs(bearing_desired(bearings)) > settings.sideways_bearing:
        return True
    return displacement(sight, settings, least_room=settings.least_room**2) is None


def is_behind(bearings: Bearings) -> bool:
    """Return whether the robot stands behind the goal and has it ahead."""
    return bearings.sigma < 0.0 and math.sin(bearings.psi) < 0.0


def displacement(
    sight: Sight, settings: ServoSettings, *, least_room: float | None = None
) -> float | None:
    """
    Return the bearing of e_au [rad] to hold in step 1, as far as the field of view allows.

    None where the spiral would leave less than ``least_room`` of the distance, that of the
    settings if not given: see ``laws.displaced_epipole``.
    """
    bearings = sight.bearings
    if bearings is None:
        return None
    here, chi = bearing_current(bearings), bearing_desired(bearings)
    epipole = laws.displaced_epipole(
        bearings.epipole_desired,
        room=settings.room,
        low=settings.min_displacement,
        high=settings.max_displacement,
    )
    left, right = sight.room
    wanted = math.atan(epipole)
    found = min(max(wanted, here - right), here + left)
    if abs(chi) <= engage_bound(sight, settings) or found == wanted:
        return found
    enough = abs(chi) / math.log(1.0 / (least_room or settings.least_room))
    return found if found * wanted > 0.0 and math.tan(abs(found)) >= enough else None


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
        return abs(sight.heading_error) <= facing_bound(settings)
    if state.phase is Phase.MATCHING_FEATURES:
        return abs(sight.difference) <= matched_bound(sight, settings)
    if state.phase is Phase.ZEROING_EPIPOLES and state.latched and sight.bearings is not None:
        return abs(bearing_current(sight.bearings)) <= align_bound(sight, settings)
    return False


def facing_bound(settings: ServoSettings) -> float:
    """Return the heading error [rad] that counts as zero: no less than the motors can turn."""
    frames = 2.0 if settings.dead_band_mode == 'raise' else 0.5
    return max(settings.arrival_heading, frames * FRAME_S * settings.dead_band_angular)


def matched_bound(sight: Sight, settings: ServoSettings) -> float:
    """Return the |D| that counts as zero: it cannot be less than its noise."""
    return max(settings.arrival_difference, NOISE_DEVIATIONS * sight.difference_deviation)


def has_parallax(state: ServoState, sight: Sight, settings: ServoSettings) -> bool:
    """Return whether the features show parallax that noise does not explain: not at the goal."""
    seen = sight.parallax if state.settled < 2 else state.settled_parallax
    # The root of a mean square over N features varies by 0.5 / sqrt(N) and more.
    noise = RESIDUAL * sight.noise * (1.0 + 1.5 / math.sqrt(max(sight.features, 1)))
    return not seen <= math.hypot(settings.arrival_parallax, noise)


def is_at_goal(state: ServoState, sight: Sight, settings: ServoSettings) -> bool:
    """Return whether the photograph could have been taken from here: heading, parallax and D."""
    faces_it = abs(sight.heading_error) <= facing_bound(settings)
    matched = abs(sight.difference) <= matched_bound(sight, settings)
    return faces_it and matched and not has_parallax(state, sight, settings)


def _survey(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    """Decide how to begin, or to begin again after the tracks came back."""
    if is_at_goal(state, sight, settings):
        return Event.MATCHED
    if sight.bearings is None:
        return Event.NO_BASELINE if sight.parallax <= settings.near_parallax else Event.LOST
    if is_sideways(sight, settings):
        return Event.SIDEWAYS
    aligned = abs(bearing_desired(sight.bearings)) <= engage_bound(sight, settings)
    if aligned and abs(bearing_current(sight.bearings)) <= align_bound(sight, settings):
        return Event.ALIGNED
    return Event.APART


def _orienting(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if state.settled < settings.align_frames:
        return Event.NOTHING
    if is_at_goal(state, sight, settings):
        return Event.MATCHED
    if is_sideways(sight, settings):
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
    inside = abs(bearing_desired(sight.bearings)) <= settings.retreat_bearing
    return Event.APART if inside and not is_sideways(sight, settings) else Event.NOTHING


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
    if not state.latched and _is_off_course(sight, settings):
        return Event.SIDEWAYS
    if state.latched and abs(bearing) > escape_bound(state, sight, settings):
        near = sight.difference > -settings.retreat_difference
        return Event.SIDEWAYS if near and settings.law == 'full' else Event.ESCAPED
    return Event.ALIGNED if state.settled >= settings.align_frames else Event.NOTHING


def _matching(state: ServoState, sight: Sight, settings: ServoSettings) -> Event:
    if _is_astray(sight, settings):
        return Event.LOST
    if state.settled < settings.arrival_frames:
        return Event.NOTHING
    if has_parallax(state, sight, settings):
        return Event.MISSED if state.attempts < settings.max_attempts else Event.EXHAUSTED
    if settings.law == 'full' and not abs(sight.heading_error) <= facing_bound(settings):
        return Event.TURNED
    return Event.MATCHED


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
