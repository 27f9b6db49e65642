"""
Where the robot is, as far as it can tell: bearings, bounds that know the noise, and judgements.

``events`` makes events of them, ``steering`` and ``recollection`` look at them as well.
"""

import math

from visual_servo_epipolar.core.control import laws
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.ranging import look_ahead, UNKNOWN_RANGE
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

ENGAGE_DEVIATIONS, RELEASE_DEVIATIONS, NOISE_DEVIATIONS = 1.0, 4.0, 2.0
RESIDUAL = 1.25  # parallax of a standstill, in deviations of the noise: see ``fit_rotation``
FOLLOWED = 1e-3  # offset that line following may leave [m]
LARGEST_ESCAPE = 0.1  # [rad]
FRAME_S = 0.1  # the shortest turn: one command, at the usual frame rate [s]


def engage_bound(measurement: Measurement, settings: ServoSettings) -> float:
    """Return the bearing of e_du [rad] that counts as zero: it cannot be less than its noise."""
    return max(settings.latch_engage, ENGAGE_DEVIATIONS * _deviation(measurement))


def release_bound(measurement: Measurement, settings: ServoSettings) -> float:
    """Return the bearing of e_du [rad] that has left zero, and not by noise alone."""
    return max(settings.latch_release, RELEASE_DEVIATIONS * _deviation(measurement))


def escape_bound(state: ServoState, measurement: Measurement, settings: ServoSettings) -> float:
    """
    Return the bearing of e_du [rad] at which step 1 has to begin anew.

    Line following shrinks an offset x by exp(0.9 d / L) on the way d that is left: what it brings
    below a millimetre need not be zeroed first, as when a camera ahead of the axle swings aside
    while the robot turns.
    """
    bound = release_bound(measurement, settings)
    if not settings.options.line_following:
        return bound
    way = state.range if state.range > 0.0 else min(state.distance, UNKNOWN_RANGE)
    follows = min(0.9 * way / look_ahead(way, settings.look_ahead), 9.0)
    return max(bound, min(FOLLOWED * math.exp(follows) / way, LARGEST_ESCAPE))


def align_bound(measurement: Measurement, settings: ServoSettings) -> float:
    """Return the bearing of e_au [rad] that counts as zero: it cannot be less than its noise."""
    return max(settings.align_tolerance, ENGAGE_DEVIATIONS * _deviation(measurement))


def _deviation(measurement: Measurement) -> float:
    return 0.0 if math.isnan(measurement.deviation) else measurement.deviation


def is_sideways(measurement: Measurement, settings: ServoSettings) -> bool:
    """
    Return whether law full backs off before step 1.

    So it does from beside or past the goal, and where the field of view leaves no room for a turn
    that would bring the robot onto the axis before it is at the goal.
    """
    return _backs_off(measurement, settings, settings.least_spiral_ratio)


def is_off_course(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether step 1, once begun, had better be given up: later than it would not begin."""
    return _backs_off(measurement, settings, settings.least_spiral_ratio**2)


def _backs_off(measurement: Measurement, settings: ServoSettings, least_ratio: float) -> bool:
    bearings, law = measurement.bearings, settings.options
    if not law.retreat or bearings is None:
        return False
    if not is_behind(bearings) or abs(bearings.chi) > settings.sideways_bearing:
        return True
    if not law.discordant_turn:
        return False
    return displacement(measurement, settings, least_ratio=least_ratio) is None


def is_behind(bearings: Bearings) -> bool:
    """Return whether the robot stands behind the goal and has it ahead."""
    return bearings.sigma < 0.0 and math.sin(bearings.psi) < 0.0


def displacement(
    measurement: Measurement, settings: ServoSettings, *, least_ratio: float | None = None
) -> float | None:
    """
    Return the bearing of e_au [rad] to hold in step 1, as far as the field of view allows.

    None where the spiral would leave less than ``least_ratio`` of the distance, that of the
    settings if not given: see ``laws.displaced_epipole``.
    """
    bearings = measurement.bearings
    if bearings is None:
        return None
    here, chi = bearings.alpha, bearings.chi
    epipole = laws.displaced_epipole(
        bearings.epipole_desired,
        ratio=settings.spiral_ratio,
        low=settings.min_displacement,
        high=settings.max_displacement,
    )
    left, right = measurement.view_margins
    wanted = math.atan(epipole)
    found = min(max(wanted, here - right), here + left)
    if abs(chi) <= engage_bound(measurement, settings) or found == wanted:
        return found
    enough = abs(chi) / math.log(1.0 / (least_ratio or settings.least_spiral_ratio))
    return found if found * wanted > 0.0 and math.tan(abs(found)) >= enough else None


def is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame fulfils the aim of the phase."""
    measurement = state.measurement
    if measurement is None or measurement.features < settings.min_features:
        return False
    if state.phase is Phase.ORIENTING:
        return abs(measurement.heading_error) <= facing_bound(settings)
    if state.phase is Phase.MATCHING_FEATURES:
        return abs(measurement.difference) <= matched_bound(measurement, settings)
    if (
        state.phase is Phase.ZEROING_EPIPOLES
        and state.latched
        and measurement.bearings is not None
    ):
        return abs(measurement.bearings.alpha) <= align_bound(measurement, settings)
    return False


def facing_bound(settings: ServoSettings) -> float:
    """Return the heading error [rad] that counts as zero: no less than the motors can turn."""
    frames = 2.0 if settings.dead_band_mode == 'raise' else 0.5
    return max(settings.arrival_heading, frames * FRAME_S * settings.dead_band_angular)


def matched_bound(measurement: Measurement, settings: ServoSettings) -> float:
    """Return the |D| that counts as zero: it cannot be less than its noise."""
    return max(settings.arrival_difference, NOISE_DEVIATIONS * measurement.difference_deviation)


def has_parallax(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether the features show parallax that noise does not explain: not at the goal."""
    seen = measurement.parallax if state.settled < 2 else state.settled_parallax
    # The root of a mean square over N features varies by 0.5 / sqrt(N) and more.
    noise = RESIDUAL * measurement.noise * (1.0 + 1.5 / math.sqrt(max(measurement.features, 1)))
    return not seen <= math.hypot(settings.arrival_parallax, noise)


def is_at_goal(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether the photograph could have been taken from here: heading, parallax and D."""
    faces_it = abs(measurement.heading_error) <= facing_bound(settings)
    matched = abs(measurement.difference) <= matched_bound(measurement, settings)
    return faces_it and matched and not has_parallax(state, measurement, settings)
