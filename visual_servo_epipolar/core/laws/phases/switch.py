"""Switch of the phase: the target, gains and counters of the new one, the reason to leave."""

import math

from visual_servo_epipolar.core.laws.phases.bounds import FACING
from visual_servo_epipolar.core.laws.phases.conditions import (
    astray,
    discordant_bearing,
    sees_too_little,
)
from visual_servo_epipolar.core.laws.phases.table import Event, next_phase, Phase
from visual_servo_epipolar.core.laws.phases.timing import usual_step
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.derived_gains import legal_target, with_gains_of_now
from visual_servo_epipolar.core.servo.identification.ranging import Leg
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.values import changed


def switched(
    state: ServoState, measurement: Measurement, event: Event, settings: ServoSettings
) -> ServoState:
    """Return the state in the phase that follows ``event``; that of NO_GAIN if none is legal."""
    phase = next_phase(state.phase, event)
    if phase is state.phase:
        return _waiting(state, measurement, settings)
    state = changed(
        state,
        phase=phase,
        phase_start_ns=measurement.stamp_ns,
        run_start_ns=measurement.stamp_ns if state.phase is Phase.WAITING else state.run_start_ns,
        mount=None if state.extrinsics is None else state.extrinsics.mount,
        # Bounds of a phase hold when it goes on after tracks were lost.
        travel=state.travel if Phase.HOLDING in (phase, state.phase) else 0.0,
        settled=0,
        lingered=0.0,
        gains=state.gains if settings.derives else None,
        reason=_reason(state, measurement, event, settings),
        restarts=0 if event is Event.MISSED else state.restarts + (event is Event.ESCAPED),
        attempts=state.attempts + (event is Event.MISSED),
        warning='',
    )
    if phase in (Phase.DISPLACING, Phase.ZEROING_EPIPOLES) and measurement.bearings is not None:
        side = math.copysign(1.0, measurement.bearings.chi)
        leg = Leg(measurement.bearings.psi)
        state = changed(state, side=side, latched=False, leg=leg)
    if phase is Phase.RETREATING:
        state = changed(state, leg=None)
    try:
        return _prepared(state, measurement, settings)
    except ValueError as error:
        state = switched(state, measurement, Event.NO_GAIN, settings)
        return changed(state, reason=str(error))


def _waiting(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    """Return ``state`` with the reason to go on waiting or holding, by this image."""
    if state.phase is Phase.HOLDING and not state.settled and measurement.reason:
        return changed(state, reason=measurement.reason)
    if state.phase is not Phase.WAITING or not sees_too_little(measurement, settings):
        return state
    return changed(state, reason=too_few_features(measurement.features, settings))


def too_few_features(features: int, settings: ServoSettings) -> str:
    """Return in words that a run cannot begin with so few features in view."""
    if features == 0:
        return 'no feature of the photograph is in view'
    return (
        f'no feature of the photograph is in view for certain: {features} found, '
        f'{settings.min_features} needed'
    )


def _prepared(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    """Return ``state`` with the target or the gains of its phase; ValueError if none is legal."""
    if state.phase is Phase.DISPLACING and settings.derives:
        return changed(state, target=legal_target(state, measurement, settings))
    if state.phase is Phase.DISPLACING:
        return changed(state, target=_target(measurement, settings))
    if settings.derives and state.phase in (Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES):
        return with_gains_of_now(state, measurement, settings)
    return state


def _target(measurement: Measurement, settings: ServoSettings) -> float:
    """Return the abscissa of e_au for DISPLACING (section IV-B, remarks; or discordant)."""
    bearings = measurement.bearings
    if bearings is None:
        return 0.0
    if not settings.options.discordant_turn:
        return math.copysign(math.tan(2.0 * settings.singular_epipole), bearings.epipole_current)
    return math.tan(discordant_bearing(measurement, settings))


def _reason(
    state: ServoState, measurement: Measurement, event: Event, settings: ServoSettings
) -> str:
    """Return the reason to leave the phase, for the log and for the verdict on the run."""
    name = state.phase.value
    run = seconds_between(state.run_start_ns, measurement.stamp_ns)
    if event is Event.TIMED_OUT and run > settings.run_timeout:
        return f'the run took longer than {settings.run_timeout:g} s, still {name}'
    if event is Event.TIMED_OUT and state.motion.troubled_since(state.phase_start_ns):
        return f'held for {settings.holding_timeout:g} s: {state.reason}'
    if event is Event.TIMED_OUT and state.phase is Phase.HOLDING:
        ago = state.settled * usual_step(state)
        lost = f'tracks lost or untrusted for {settings.holding_timeout:g} s'
        return f'{lost}: {state.reason}, {ago:.1f} s ago'
    if event is Event.TIMED_OUT:
        because = f': {state.warning}' if state.warning else ''
        return f'{name} took longer than {settings.phase_timeout:g} s{because}'
    if event is Event.ASTRAY:
        return astray(state, measurement, settings)
    if event is Event.DIVERGED:
        return f'the desired epipole ran away to infinity in {name}'
    if event in (Event.MISSED, Event.EXHAUSTED):
        error = measurement.feature_error * measurement.focal
        missed = (
            f'features are {error:.1f} px off, parallax {measurement.parallax_px:.1f} px, '
            f'at the end of attempt {state.attempts}'
        )
        return missed + _against_tolerances(measurement, settings)
    if event is Event.DISOBEYED:
        return f'{state.motion.contradictions} times in this run: {measurement.reason}'
    if state.motion.trouble:
        return measurement.reason
    if event is Event.LOST and not math.isfinite(measurement.difference):
        return measurement.reason or 'no feature is ahead in both views'
    if event is Event.LOST:
        return measurement.reason or f'bearings not trusted in {name}'
    return str(event.value)


def _against_tolerances(measurement: Measurement, settings: ServoSettings) -> str:
    """Return in words how far off the robot is in the terms of the tolerances that are told."""
    words = ''
    if settings.arrival_position > 0.0 and measurement.offset is not None:
        offset = 1e3 * math.hypot(*measurement.offset)
        words = f', {offset:.1f} mm away (arrival_position)'
    if settings.arrival_heading > FACING:
        degrees = math.degrees(abs(measurement.heading_error))
        words += f', turned by {degrees:.2f} deg (arrival_heading)'
    return words
