"""
Supervisor: what a run decides by each image.

The image is perceived (estimated, validated, measured: ``perception.perceive``) and updates the
state (``estimator``). The measurement becomes an event, the event a phase by the law's machine,
and the phase a nominal velocity, which is then limited to what the base can follow.

The clock of the stamps is not ours: it may be set while the robot drives. Where it leaps, the
stamps at which phase and run began are moved along, so that limits count the time that passed, one
usual period, and go on by the new clock.
"""

from dataclasses import replace
import math
from typing import cast

from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.estimate.goal_estimate import (
    GoalEstimate,
    usual_step,
    USUAL_STEP_S,
)
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.arrival import FACING
from visual_servo_epipolar.core.laws.conditions import excursion_limit, sees_too_little
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.prediction import predicted
from visual_servo_epipolar.core.laws.standing import classify_probe, is_probing, probe
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.rigs.rig import Command, Gaze, HeadCommand
from visual_servo_epipolar.core.servo.checking import check_lens, check_motion
from visual_servo_epipolar.core.servo.estimator import estimate, update_map
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import pulsed_move, row_of, settle
from visual_servo_epipolar.core.servo.state import ServoState, ViewState
from visual_servo_epipolar.core.stamps import (
    MOST_GAP_S,
    NANOSECONDS,
    NOT_ADVANCING,
    seconds_between,
)
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive, Perception

HALF_TURNS = 3.0  # at full speed, that no turn in place takes
LATE_S = 0.02  # by which a command may go out late of its image, and the next in time


def classify(state: ServoState, settings: ServoSettings) -> Event:
    """Return the event of ``state.measurement`` in ``state.phase``."""
    goal, phase = state.settling.rest or state.measurement, state.phase
    if goal is None or phase.ended:
        return Event.NOTHING
    if has_timed_out(state, goal, settings):
        return Event.TIMED_OUT
    if state.check.trouble:  # motion contradicts the commands: hold, or end where it recurs
        held = Event.LOST if phase.drives else Event.NOTHING
        return Event.DISOBEYED if state.check.is_final else held
    if sees_too_little(goal, settings):
        return Event.LOST if phase.drives else Event.NOTHING
    if excursion_limit(goal, state, settings):
        return Event.EXCURSION
    if is_probing(state):
        return classify_probe(goal, state, settings)
    event = row_of(state, settings).classify(goal, state, settings)
    straight_on = settings.machine.next_phase(phase, event).straight
    return Event.LOST if straight_on and not math.isfinite(goal.difference) else event


def nominal_twist(state: ServoState, settings: ServoSettings) -> Twist:
    """Return the nominal twist of the phase: that of its law, before saturation."""
    if state.measurement is None:
        return STANDSTILL
    goal = predicted(state.measurement, state.phase, settings)
    command = probe if is_probing(state) else row_of(state, settings).command
    return command(goal, state, settings)


def compensate_curvature(twist: Twist, state: ServoState, settings: ServoSettings) -> Twist:
    """Return ``twist`` less the turn c u_1 that the identified curvature c would add to it."""
    if not settings.options.curvature_feedforward:
        return twist
    return Twist(twist.linear, twist.angular - state.identified.curvature.value * twist.linear)


def switch_phase(
    state: ServoState, goal: GoalEstimate, event: Event, settings: ServoSettings
) -> ServoState:
    """Return the state in the phase that follows ``event``; that of NO_GAIN if none is legal."""
    phase = settings.machine.next_phase(state.phase, event)
    if phase is state.phase:
        return _waiting(state, goal, settings)
    restarts = 0 if event is Event.MISSED else state.run.restarts + _gives_up(state.phase, event)
    state = state.changed(
        phase=phase,
        event=event,
        phase_start_ns=goal.stamp_ns,
        run_start_ns=goal.stamp_ns if state.phase is Phase.WAITING else state.run.run_start_ns,
        mount=None if state.identified.extrinsics is None else state.identified.extrinsics.mount,
        # Bounds of a phase hold when it goes on after tracks were lost.
        travel=state.run.travel if Phase.HOLDING in (phase, state.phase) else 0.0,
        settled=0,
        # What a phase could not do near the goal, the turn that ends it is not to try again, nor
        # the phase after that turn.
        time_in_tolerance=state.settling.time_in_tolerance
        if event is Event.TURNED or state.phase is Phase.ORIENTING
        else 0.0,
        gains=state.law.gains if settings.derives else None,
        reason=_reason(state, goal, event, settings),
        restarts=restarts,
        attempts=state.run.attempts + (event is Event.MISSED),
        warning='',
    )
    try:
        return cast(ServoState, row_of(state, settings).begin(goal, state, settings))
    except ValueError as error:
        state = switch_phase(state, goal, Event.NO_GAIN, settings)
        return state.changed(reason=str(error))


def _gives_up(phase: Phase, event: Event) -> bool:
    """Return whether step 1 was given up: anew, for a retreat or a probe, or out of view."""
    backs_off = phase is Phase.ZEROING_EPIPOLES and event is Event.SIDEWAYS
    out_of_view = phase is Phase.DISPLACING and event is Event.LOST
    return (
        backs_off or out_of_view or event in (Event.ESCAPED, Event.AMBIGUOUS, Event.AMBIGUOUS_NEAR)
    )


def _waiting(state: ServoState, goal: GoalEstimate, settings: ServoSettings) -> ServoState:
    """Return ``state`` with the reason to go on waiting, orienting or holding, by this image."""
    if state.run.event is Event.NO_BASELINE and goal.bearings is not None:
        return state.changed(reason='')  # it ends where bearings are trusted
    if state.phase is Phase.HOLDING and not state.settling.settled and goal.reason:
        return state.changed(reason=goal.reason)
    if state.phase is not Phase.WAITING or not sees_too_little(goal, settings):
        return state
    return state.changed(reason=too_few_features(goal.features, settings))


def too_few_features(features: int, settings: ServoSettings) -> str:
    """Return in words that a run cannot begin with so few features in view."""
    if features == 0:
        return Reason.NONE_IN_VIEW.of()
    return Reason.FEW_IN_VIEW.of(features, settings.min_features)


def _reason(state: ServoState, goal: GoalEstimate, event: Event, settings: ServoSettings) -> str:
    """Return the reason to leave the phase, for the log and for the verdict on the run."""
    name = state.phase.value
    run = seconds_between(state.run.run_start_ns, goal.stamp_ns)
    if event is Event.TIMED_OUT and run > settings.run_timeout:
        return Reason.RUN_TIMED_OUT.of(settings.run_timeout, name)
    if event is Event.TIMED_OUT and state.check.troubled_since(state.run.phase_start_ns):
        return Reason.HELD.of(settings.holding_timeout, state.reason)
    if event is Event.TIMED_OUT and state.phase is Phase.HOLDING:
        ago = state.settling.settled * usual_step(state.view.period)
        return Reason.LOST.of(settings.holding_timeout, state.reason, ago)
    if event is Event.TIMED_OUT:
        return _too_long(state, settings)
    if event is Event.EXCURSION:
        return excursion_limit(goal, state, settings)
    if event is Event.DIVERGED:
        return Reason.DIVERGED.of(name)
    if event in (Event.MISSED, Event.EXHAUSTED):
        error = goal.feature_error * goal.focal
        beyond = _against_tolerances(goal, settings)
        return Reason.MISSED.of(error, goal.parallax_px, state.run.attempts, beyond)
    if event is Event.DISOBEYED and state.check.head.slip:
        return goal.reason
    if event is Event.DISOBEYED:
        return Reason.DISOBEYED.of(state.check.contradictions, goal.reason)
    if state.check.trouble:
        return goal.reason
    if event is Event.LOST and not math.isfinite(goal.difference):
        return goal.reason or Reason.NONE_AHEAD.of()
    if event is Event.LOST:
        return goal.reason or Reason.UNTRUSTED.of(name)
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


def update(
    state: ServoState, perception: Perception, dt: float, settings: ServoSettings
) -> ServoState:
    """Return the state updated by a ``perception``; ``settings`` have what was identified."""
    after = estimate(state, perception, dt, settings)
    if after.measurement is not None:
        latched = row_of(after, settings).observe(after.measurement, after, settings)
        after = cast(ServoState, latched)
    return settle(after, perception.observation, state.measurement, dt, settings)


def step(
    state: ServoState,
    observation: Observation,
    settings: ServoSettings,
    *,
    since_command: float = math.nan,
) -> ServoState:
    """Return the state after an ``observation``, with the ``command``; see ``decide``."""
    return update_map(decide(state, observation, settings, since_command=since_command))


def decide(
    state: ServoState,
    observation: Observation,
    settings: ServoSettings,
    *,
    since_command: float = math.nan,
) -> ServoState:
    """Return the state with the ``command``; ``since_command`` [s] is nan where stamps count."""
    perception = perceive(observation, settings, state.view.frame, state.view.memory)
    return advance(state, perception, settings, since_command=since_command)


def advance(
    state: ServoState,
    perception: Perception,
    settings: ServoSettings,
    *,
    since_command: float = math.nan,
) -> ServoState:
    """Return the state after a ``perception``: the part of ``decide`` that needs no features."""
    last_twist, measurement = state.twist, perception.measurement
    usual_s = usual_step(state.view.period)
    leapt = clock_jump(state, measurement.stamp_ns, settings)
    dt = 0.0 if leapt else time_step(state, measurement.stamp_ns)
    if leapt:
        state = after_clock_jump(state, measurement.stamp_ns)
    settings = state.identified.effective(settings)
    state = state.changed(sent=state.motion.sent.resumed(measurement.stamp_ns))
    state = update(state, perception, dt, settings)
    state = check_motion(state, perception.observation, dt, settings)
    event = classify(state, settings)
    if leapt and event not in (Event.TIMED_OUT, Event.EXCURSION):
        event = Event.LOST if state.phase.drives else Event.NOTHING
        if state.phase.drives and state.measurement is not None:
            state = state.changed(measurement=replace(state.measurement, reason=leapt))
    state, event = check_lens(state, perception.observation, event, settings)
    if state.measurement is not None:
        state = switch_phase(state, state.measurement, event, settings)
    nominal = nominal_twist(state, settings)
    nominal = compensate_curvature(nominal, state, settings)
    ramp_s = _ramp_step(last_twist, dt, usual_s, since_command)
    limited = _limited(nominal, last_twist, ramp_s, state, settings)
    twist, residual = _beyond_dead_band(limited, state, settings)
    head = _head_command(state.view, perception.observation, twist, settings)
    return state.changed(
        command=Command(twist, head),
        since_command=since_command,
        dead_band_residual=residual,
        sent=state.motion.sent.after(measurement.stamp_ns, twist),
        frame=state.view.frame + 1,
    )


def _head_command(
    view: ViewState, observation: Observation | None, twist: Twist, settings: ServoSettings
) -> HeadCommand | None:
    """Return what the head is to do; None of a rig without one."""
    if observation is None or observation.joints is None:
        return None
    gaze = Gaze(
        observation.joints,
        observation.current,
        observation.desired,
        twist,
        USUAL_STEP_S if math.isnan(view.period) else view.period,
        view.unseen(observation.stamp_ns),
    )
    return settings.carrier.head_command(gaze)


def _ramp_step(last: Twist, dt: float, usual_s: float, since_command: float) -> float:
    """Return the time that ramps count since ``last`` [s]: neither pauses nor gaps of stamps."""
    dt = dt or USUAL_STEP_S
    if not math.isnan(since_command):
        dt = min(dt, since_command + LATE_S)
    return Limiter(last).ramp_step(dt, usual_s)


def _limited(
    nominal: Twist, last: Twist, dt: float, state: ServoState, settings: ServoSettings
) -> Twist:
    """Return ``nominal`` within the limits of speed, and of acceleration since ``last``."""
    ramps = settings.options.speed_ramps and state.phase.drives
    ratio = settings.max_speed_ratio
    return Limiter(last).within_limits(nominal, dt, settings.drive, ratio=ratio, ramps=ramps)


def _beyond_dead_band(
    limited: Twist, state: ServoState, settings: ServoSettings
) -> tuple[Twist, Twist]:
    """Return the part of ``limited`` that the motors can follow, and the residual for later."""
    if state.settling.rest is not None and state.settling.settled:
        return STANDSTILL, STANDSTILL  # by the mean of a stand, from which a command leads away
    # Where the aim is fulfilled, a small command made larger would only undo it.
    mode = 'zero' if state.settling.settled else settings.dead_band_mode
    if mode == 'pulse' and (move := pulsed_move(limited, state, settings)):
        return move
    return settings.drive.beyond_dead_band(limited, state.dead_band_residual, mode=mode)


def time_step(state: ServoState, stamp_ns: int) -> float:
    """Return the time from the last image to ``stamp_ns`` to integrate over [s]."""
    if state.measurement is None:
        return 0.0
    return min(max(seconds_between(state.measurement.stamp_ns, stamp_ns), 0.0), MOST_GAP_S)


def clock_jump(state: ServoState, stamp_ns: int, settings: ServoSettings) -> str:
    """
    Return in words how the stamps leap to ``stamp_ns`` from the last image; empty if they do not.

    They must advance. A driving robot has an image before the last is stale; a standing one may
    have waited for as long as the stamps say.
    """
    if state.measurement is None:
        return ''
    gap = seconds_between(state.measurement.stamp_ns, stamp_ns)
    if gap <= 0.0:
        return NOT_ADVANCING
    if not state.phase.drives or gap <= max(settings.stale_timeout, MOST_GAP_S):
        return ''
    return Reason.STAMPS_LEAPT.of(gap)


def after_clock_jump(state: ServoState, stamp_ns: int) -> ServoState:
    """Return ``state`` by the clock that leapt to ``stamp_ns``: one usual period has passed."""
    if state.measurement is None:
        return state
    passed_ns = round(usual_step(state.view.period) * NANOSECONDS)
    leap_ns = stamp_ns - state.measurement.stamp_ns - passed_ns
    return state.changed(
        phase_start_ns=state.run.phase_start_ns + leap_ns,
        run_start_ns=state.run.run_start_ns + leap_ns,
    )


def has_timed_out(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether the run or the phase has lasted too long; waiting may last for ever."""
    if not state.phase.runs:
        return False
    holding = state.phase is Phase.HOLDING
    run_time = seconds_between(state.run.run_start_ns, measurement.stamp_ns)
    phase_time = seconds_between(state.run.phase_start_ns, measurement.stamp_ns)
    timeout = settings.holding_timeout if holding else phase_timeout(state.phase, settings)
    return run_time > settings.run_timeout or phase_time > timeout


def phase_timeout(phase: Phase, settings: ServoSettings) -> float:
    """
    Return how long a ``phase`` may last [s]: a turn in place that brakes as long as some turns.

    One that takes longer swings about its aim: it looks larger than it is.
    """
    if phase is not Phase.DISPLACING or not settings.options.speed_ramps:
        return settings.phase_timeout
    slowest = settings.max_speed_ratio * settings.max_angular
    half_turn = math.pi / slowest + slowest / settings.max_angular_acceleration
    return min(settings.phase_timeout, HALF_TURNS * half_turn)
