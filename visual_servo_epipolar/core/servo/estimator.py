"""
Estimator: what one perception makes of goal, camera and base, in order.

What was driven since the last image, the fusion of two views with the map, identification of mount
and base, dead reckoning; then the estimate of the goal, one value. The map learns after the twist.
"""

from dataclasses import replace

from visual_servo_epipolar.core.estimate.goal_estimate import goal_estimate
from visual_servo_epipolar.core.laws.phases.conditions import has_turned, is_untrusted
from visual_servo_epipolar.core.laws.state import ViewState
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.perception.validated import noise_learnt
from visual_servo_epipolar.core.servo.dead_reckoning import (
    desired_rate,
    drive_since,
    jitter,
    reckon,
    usual_period,
)
from visual_servo_epipolar.core.servo.fuse import fuse, Fusion, with_wrong_matches
from visual_servo_epipolar.core.servo.identify import identify
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import Identification, ServoState


def estimate(
    state: ServoState, perception: Perception, dt: float, settings: ServoSettings
) -> ServoState:
    """Return the state by a ``perception``, with the estimate of the goal after it."""
    drive = drive_since(state, perception, dt, settings)
    fusion = fuse(state, perception, drive.increment, dt, settings)
    fusion, identified = identify(state, perception, fusion, drive, settings)
    measurement = fusion.measurement
    return state.changed(
        view=_see(state, fusion, identified, perception.observation, dt, settings),
        goal=replace(state.goal, map=fusion.map),
        identified=identified,
        motion=reckon(state, measurement, identified, drive, settings),
        desired_rate=desired_rate(state, measurement, dt),
    )


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
