"""
From what the servo sees to gains: ``gains.derive`` at the moment step 1 begins.

Where no gain is legal the robot turns first, as section IV-C 2 has it for concordant epipoles
too close to the singularity; where no turn can help, the run fails with the reason.
"""

import math

from visual_servo_epipolar.core.control.gains import Circumstances, derive, Gains
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.phases.conditions import (
    displacement,
    engage_bound,
)
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

NEARLY_ZERO = 2.0  # landings, where e_du counts as zero already


def gains_here(state: ServoState, measurement: Measurement, settings: ServoSettings) -> Gains:
    """
    Return the gains for step 1 or 2, derived from where the robot stands.

    Raises
    ------
    ValueError
        If no gain is legal from here: see ``gains.derive``.

    """
    facing = 0.0 if measurement.bearings is None else measurement.bearings.alpha
    return derive(circumstances(state, measurement, settings, facing=facing))


def circumstances(
    state: ServoState, measurement: Measurement, settings: ServoSettings, *, facing: float
) -> Circumstances:
    """
    Return what is known now, with e_au at the bearing ``facing`` [rad].

    d_hat - d does not change while d_hat follows (13), so that d is still bounded from below as
    it was at the start. Step 2 begins aligned: its k_t depends on no bearing.
    """
    zero = state.phase is Phase.MATCHING_FEATURES or measurement.bearings is None
    other = 0.0 if measurement.bearings is None else measurement.bearings.chi
    zero = zero or abs(other) <= engage_bound(measurement, settings)
    landing = max(settings.latch_engage, 1e-6)
    farthest = min(max(state.distance, 0.1), 100.0)
    certain = farthest - (settings.initial_distance - settings.nearest_distance)
    return Circumstances(
        concordant=not zero and facing * other > 0.0,
        current=min(max(abs(facing), 0.001), 1.0 if zero else 1.57),
        desired=max(NEARLY_ZERO * landing, 0.001) if zero else min(max(abs(other), 0.001), 1.56),
        farthest=farthest,
        nearest=min(max(certain, settings.min_distance, 0.05), farthest),
        max_linear=settings.max_linear,
        max_angular=settings.max_angular,
        deceleration=min(2.0 * settings.max_acceleration, 20.0),  # slowing down is twice as fast
        rate=min(max(1.0 / state.period, 0.5), 1000.0) if state.period > 0.0 else 11.0,
        latency=settings.latency,
        landing=landing,
        depth=settings.scene_depth,
    )


def legal_target(state: ServoState, measurement: Measurement, settings: ServoSettings) -> float:
    """
    Return where DISPLACING puts e_au so that there are gains: where it is, or discordant.

    Raises
    ------
    ValueError
        If there are none in either place.

    """
    if measurement.bearings is None:
        return 0.0
    here, turned = measurement.bearings.alpha, displacement(measurement, settings)
    places = [turned or 0.0]
    if not settings.options.discordant_turn:
        clear = abs(here) >= 2.0 * settings.singular_epipole
        places = ([here] if clear else []) + ([] if turned is None else [turned])
    reason = 'the field of view leaves no room to turn e_au to where a gain is legal'
    for place in places:
        try:
            derive(_near(place, state, measurement, settings))
        except ValueError as error:
            reason = str(error)
        else:
            return math.tan(place)
    raise ValueError(reason)


def _near(
    place: float, state: ServoState, measurement: Measurement, settings: ServoSettings
) -> Circumstances:
    """Return the circumstances at the worst place that passes for ``place``."""
    off = settings.displacement_tolerance
    known = circumstances(state, measurement, settings, facing=place)
    inwards = known.concordant
    facing = max(abs(place) - off, 0.0) if inwards else abs(place) + off
    return circumstances(state, measurement, settings, facing=math.copysign(facing, place))
