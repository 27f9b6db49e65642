"""Decisions of a step: from a measurement in a phase to the next phase, by the law's machine."""

import math
from typing import cast

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.machine import PhaseRow
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.bounds import FACING
from visual_servo_epipolar.core.laws.phases.conditions import excursion_limit, sees_too_little
from visual_servo_epipolar.core.laws.phases.probing import classify_probe, is_probing, probe
from visual_servo_epipolar.core.laws.timing import (
    has_timed_out,
    phase_timeout,
    predicted,
    usual_step,
)
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between


def row_of(state: ServoState, settings: ServoSettings) -> PhaseRow:
    """Return the row of the present phase, of the law that drives."""
    return settings.machine.row(state.phase)


def at_rest(state: ServoState) -> ServoState:
    """Return ``state`` with the mean of its measurements since it stands, if it does."""
    mean = state.settling.rest
    return state if mean is None else state.changed(measurement=mean)


def classify(state: ServoState, settings: ServoSettings) -> Event:
    """Return the event of ``state.measurement`` in ``state.phase``."""
    state = at_rest(state)
    measurement, phase = state.measurement, state.phase
    if measurement is None or phase.ended:
        return Event.NOTHING
    if has_timed_out(state, measurement, settings):
        return Event.TIMED_OUT
    if state.check.trouble:
        return _disobeyed(state)
    if sees_too_little(measurement, settings):
        return Event.LOST if phase.drives else Event.NOTHING
    if excursion_limit(state, measurement, settings):
        return Event.EXCURSION
    if is_probing(state):
        return classify_probe(state, measurement, settings)
    event = row_of(state, settings).classify(state, measurement, settings)
    straight_on = settings.machine.next_phase(phase, event).straight
    return Event.LOST if straight_on and not math.isfinite(measurement.difference) else event


def _disobeyed(state: ServoState) -> Event:
    """Return the event of a motion that contradicts the commands: hold, or end where it recurs."""
    if state.check.is_final:
        return Event.DISOBEYED
    return Event.LOST if state.phase.drives else Event.NOTHING


def nominal_twist(state: ServoState, settings: ServoSettings) -> Twist:
    """Return the nominal twist of the phase: that of its law, before saturation."""
    if state.measurement is None:
        return STANDSTILL
    if is_probing(state):
        return probe(state, state.measurement, settings)
    return row_of(state, settings).command(state, state.measurement, settings)


def compensate_curvature(twist: Twist, state: ServoState, settings: ServoSettings) -> Twist:
    """Return ``twist`` less the turn c u_1 that the identified curvature c would add to it."""
    if not settings.options.curvature_feedforward:
        return twist
    return Twist(twist.linear, twist.angular - state.identified.curvature.value * twist.linear)


def is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame fulfils the aim of the phase."""
    if state.settling.rest is not None:
        return _is_settled(at_rest(state), settings)
    if not _is_settled(state, settings):
        return False
    # Commands that have not acted yet must not lead away again.
    ahead = predicted(state, settings)
    return ahead is state or _is_settled(ahead, settings)


def _is_settled(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether the measurement of ``state`` fulfils the aim of the phase."""
    measurement = state.measurement
    if measurement is None or sees_too_little(measurement, settings):
        return False
    return row_of(state, settings).is_settled(state, measurement, settings)


def is_close(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether this frame is within the usual bounds, where a memory asks for finer ones."""
    state = at_rest(state)
    measurement = state.measurement
    if measurement is None:
        return False
    return row_of(state, settings).is_close(state, measurement, settings)


def switch_phase(
    state: ServoState, measurement: Measurement, event: Event, settings: ServoSettings
) -> ServoState:
    """Return the state in the phase that follows ``event``; that of NO_GAIN if none is legal."""
    phase = settings.machine.next_phase(state.phase, event)
    if phase is state.phase:
        return _waiting(state, measurement, settings)
    state = state.changed(
        phase=phase,
        event=event,
        phase_start_ns=measurement.stamp_ns,
        run_start_ns=measurement.stamp_ns
        if state.phase is Phase.WAITING
        else state.run.run_start_ns,
        mount=None if state.identified.extrinsics is None else state.identified.extrinsics.mount,
        # Bounds of a phase hold when it goes on after tracks were lost.
        travel=state.motion.travel if Phase.HOLDING in (phase, state.phase) else 0.0,
        settled=0,
        # What a phase could not do near the goal, the turn that ends it is not to try again.
        time_in_tolerance=state.settling.time_in_tolerance if event is Event.TURNED else 0.0,
        gains=state.law.gains if settings.derives else None,
        reason=_reason(state, measurement, event, settings),
        restarts=0
        if event is Event.MISSED
        else state.run.restarts + _gives_up(state.phase, event),
        attempts=state.run.attempts + (event is Event.MISSED),
        warning='',
    )
    try:
        return cast(ServoState, row_of(state, settings).begin(state, measurement, settings))
    except ValueError as error:
        state = switch_phase(state, measurement, Event.NO_GAIN, settings)
        return state.changed(reason=str(error))


def _gives_up(phase: Phase, event: Event) -> bool:
    """Return whether step 1 was given up: anew, for a retreat or a probe, or out of view."""
    backs_off = phase is Phase.ZEROING_EPIPOLES and event is Event.SIDEWAYS
    out_of_view = phase is Phase.DISPLACING and event is Event.LOST
    return (
        backs_off or out_of_view or event in (Event.ESCAPED, Event.AMBIGUOUS, Event.AMBIGUOUS_NEAR)
    )


def _waiting(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    """Return ``state`` with the reason to go on waiting, orienting or holding, by this image."""
    if state.run.event is Event.NO_BASELINE and measurement.bearings is not None:
        return state.changed(reason='')  # it ends where bearings are trusted
    if state.phase is Phase.HOLDING and not state.settling.settled and measurement.reason:
        return state.changed(reason=measurement.reason)
    if state.phase is not Phase.WAITING or not sees_too_little(measurement, settings):
        return state
    return state.changed(reason=too_few_features(measurement.features, settings))


def too_few_features(features: int, settings: ServoSettings) -> str:
    """Return in words that a run cannot begin with so few features in view."""
    if features == 0:
        return Reason.NONE_IN_VIEW.of()
    return Reason.FEW_IN_VIEW.of(features, settings.min_features)


def _reason(
    state: ServoState, measurement: Measurement, event: Event, settings: ServoSettings
) -> str:
    """Return the reason to leave the phase, for the log and for the verdict on the run."""
    name = state.phase.value
    run = seconds_between(state.run.run_start_ns, measurement.stamp_ns)
    if event is Event.TIMED_OUT and run > settings.run_timeout:
        return Reason.RUN_TIMED_OUT.of(settings.run_timeout, name)
    if event is Event.TIMED_OUT and state.check.troubled_since(state.run.phase_start_ns):
        return Reason.HELD.of(settings.holding_timeout, state.reason)
    if event is Event.TIMED_OUT and state.phase is Phase.HOLDING:
        ago = state.settling.settled * usual_step(state)
        return Reason.LOST.of(settings.holding_timeout, state.reason, ago)
    if event is Event.TIMED_OUT:
        return _too_long(state, settings)
    if event is Event.EXCURSION:
        return excursion_limit(state, measurement, settings)
    if event is Event.DIVERGED:
        return Reason.DIVERGED.of(name)
    if event in (Event.MISSED, Event.EXHAUSTED):
        error = measurement.feature_error * measurement.focal
        beyond = _against_tolerances(measurement, settings)
        return Reason.MISSED.of(error, measurement.parallax_px, state.run.attempts, beyond)
    if event is Event.DISOBEYED and state.check.head.slip:
        return measurement.reason
    if event is Event.DISOBEYED:
        return Reason.DISOBEYED.of(state.check.contradictions, measurement.reason)
    if state.check.trouble:
        return measurement.reason
    if event is Event.LOST and not math.isfinite(measurement.difference):
        return measurement.reason or Reason.NONE_AHEAD.of()
    if event is Event.LOST:
        return measurement.reason or Reason.UNTRUSTED.of(name)
    return str(event.value)


def _too_long(state: ServoState, settings: ServoSettings) -> str:
    """Return in words that the phase takes longer than it may, and why."""
    most = phase_timeout(state.phase, settings)
    because = f': {state.run.warning}' if state.run.warning else ''
    if most < settings.phase_timeout:
        because = Reason.SWINGS.of()
    return Reason.PHASE_TIMED_OUT.of(state.phase.value, most, because)


def _against_tolerances(measurement: Measurement, settings: ServoSettings) -> str:
    """Return in words how far off the robot is in the terms of the configured tolerances."""
    words = ''
    if settings.arrival_position > 0.0 and measurement.offset is not None:
        offset = 1e3 * math.hypot(*measurement.offset)
        words = f', {offset:.1f} mm away (arrival_position)'
    if settings.arrival_heading > FACING:
        degrees = math.degrees(abs(measurement.heading_error))
        words += f', turned by {degrees:.2f} deg (arrival_heading)'
    return words
