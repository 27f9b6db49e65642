"""
Control step: from an observation and the state to the next state, with its command.

The replay of a bag and the simulation in memory call ``step``; the live node calls its two halves,
``decide`` and ``update_map``, and sends the command in between. An observation is perceived
(estimated, validated, measured: ``perception.perceive``), the measurement updates the state
(``update``), it becomes an event, the event a phase, the phase a nominal velocity, as the law has
it (``laws.decisions``), which is then limited to what the base can follow.
"""

from dataclasses import replace
import math
from typing import cast

from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.estimate.goal_estimate import goal_estimate
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.command import Command
from visual_servo_epipolar.core.laws.phase import Event
from visual_servo_epipolar.core.laws.phases.conditions import has_turned, is_untrusted
from visual_servo_epipolar.core.laws.state import ViewState
from visual_servo_epipolar.core.laws.timing import (
    after_clock_jump,
    clock_jump,
    predicted,
    time_step,
    usual_step,
    USUAL_STEP_S,
)
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive, Perception
from visual_servo_epipolar.core.perception.validated import noise_learnt
from visual_servo_epipolar.core.rigs.rig import Gaze, HeadCommand
from visual_servo_epipolar.core.servo.checking import check_lens, check_motion
from visual_servo_epipolar.core.servo.dead_reckoning import (
    desired_rate,
    drive_since,
    jitter,
    reckon,
    usual_period,
)
from visual_servo_epipolar.core.servo.decisions import (
    classify,
    compensate_curvature,
    nominal_twist,
    row_of,
    switch_phase,
)
from visual_servo_epipolar.core.servo.fuse import fuse, Fusion, with_wrong_matches
from visual_servo_epipolar.core.servo.identify import identify
from visual_servo_epipolar.core.servo.pulsed_move import pulsed_move
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import settle
from visual_servo_epipolar.core.servo.state import Identification, ServoState

LATE_S = 0.02  # by which a command may go out late of its image, and the next in time


def update(
    state: ServoState, perception: Perception, dt: float, settings: ServoSettings
) -> ServoState:
    """Return the state updated by a ``perception``; ``settings`` have what was identified."""
    drive = drive_since(state, perception, dt, settings)
    fusion = fuse(state, perception, drive.increment, dt, settings)
    fusion, identified = identify(state, perception, fusion, drive, settings)
    measurement = fusion.measurement
    after = state.changed(
        view=_see(state, fusion, identified, perception.observation, dt, settings),
        goal=replace(state.goal, map=fusion.map),
        identified=identified,
        motion=reckon(state, measurement, identified, drive, settings),
        desired_rate=desired_rate(state, measurement, dt),
    )
    latched = row_of(after, settings).observe(after, measurement, settings)
    return settle(cast(ServoState, latched), perception, state.measurement, dt, settings)


def _see(
    state: ServoState,
    fusion: Fusion,
    identified: Identification,
    observation: Observation | None,
    dt: float,
    settings: ServoSettings,
) -> ViewState:
    """Return what is seen, with what perception and the map carry on."""
    mounted = identified.extrinsics or settings.extrinsics
    return ViewState(
        measurement=fusion.measurement,
        estimate=goal_estimate(
            fusion.measurement, fusion.reading, mounted, identified.base, fusion.map.place
        ),
        memory=fusion.memory,
        period=usual_period(state.view.period, dt),
        jitter=jitter(state.view, dt),
        rotation_bias=fusion.rotation_bias,
        trusted_heading=_trusted_heading(state, fusion.measurement, settings),
        frame=state.view.frame,
        seen_ns=_seen_ns(state, fusion.measurement, settings),
        joints=None if observation is None else observation.joints,
    )


def _seen_ns(state: ServoState, measurement: Measurement, settings: ServoSettings) -> int:
    """Return when enough features were seen last; or the first image, if never."""
    before = state.view.seen_ns
    enough = measurement.features >= settings.min_features
    return measurement.stamp_ns if enough or before is None else before


def _trusted_heading(
    state: ServoState, measurement: Measurement, settings: ServoSettings
) -> float:
    """Return the heading error of the last trusted image by which it drove [rad]."""
    trusted = state.phase.drives and not is_untrusted(measurement, settings)
    if trusted and not has_turned(state, measurement):
        return measurement.heading_error
    return state.view.trusted_heading


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


def update_map(state: ServoState) -> ServoState:
    """Return the state after what no command waits for."""
    views, memory = state.map.update_map(), state.view.memory
    if memory is not None:
        memory = noise_learnt(memory)
    if views is not state.map:
        memory = with_wrong_matches(memory, views)
    elif memory is state.view.memory:
        return state
    return state.changed(goal=replace(state.goal, map=views), memory=memory)


def advance(
    state: ServoState,
    perception: Perception,
    settings: ServoSettings,
    *,
    since_command: float = math.nan,
) -> ServoState:
    """Return the state after a ``perception``: the part of ``decide`` that needs no features."""
    last_twist, measurement, usual_s = state.twist, perception.measurement, usual_step(state)
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
        state, event = _held(state, leapt)
    state, event = check_lens(state, perception.observation, event, settings)
    state = switch_phase(state, state.measurement or measurement, event, settings)
    nominal = nominal_twist(predicted(state, settings), settings)
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


def _held(state: ServoState, leapt: str) -> tuple[ServoState, Event]:
    """Return state and event of an image whose stamp leaps: hold if driving."""
    if not state.phase.drives or state.measurement is None:
        return state, Event.NOTHING
    return state.changed(measurement=replace(state.measurement, reason=leapt)), Event.LOST


def _limited(
    nominal: Twist, last: Twist, dt: float, state: ServoState, settings: ServoSettings
) -> Twist:
    """Return ``nominal`` within the limits of speed, and of acceleration since ``last``."""
    ramps = settings.options.speed_ramps and state.phase.drives
    limiter, ratio = Limiter(last, state.motion.sent.acceleration), settings.max_speed_ratio
    return limiter.within_limits(nominal, dt, settings.drive, ratio=ratio, ramps=ramps)


def _beyond_dead_band(
    limited: Twist, state: ServoState, settings: ServoSettings
) -> tuple[Twist, Twist]:
    """Return the part of ``limited`` that the motors can follow, and the residual for later."""
    # Where the aim is fulfilled, a small command made larger would only undo it.
    mode = 'zero' if state.settling.settled else settings.dead_band_mode
    if mode == 'pulse' and (move := pulsed_move(limited, state, settings)):
        return move
    residual, last = state.motion.dead_band_residual, state.twist
    # What is left of a pulse that was more than enough is no reason for one back.
    residual = Twist(
        0.0 if limited.linear * last.linear < 0.0 else residual.linear,
        0.0 if limited.angular * last.angular < 0.0 else residual.angular,
    )
    return settings.drive.beyond_dead_band(limited, residual, mode=mode)
