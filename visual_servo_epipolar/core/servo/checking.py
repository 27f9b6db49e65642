"""
Checking: undoes estimates where motion or matches contradict commands or calibration.

No estimate uses such a motion. Estimates since it may have begun are restored until it is over,
except for the dead band, which shows where the base stands.
"""

from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import median
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.motion_check import (
    Evidence,
    MotionCheck,
    NOISE_OF_PARALLAX,
)
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import Known, ServoState
from visual_servo_epipolar.core.twoview.lens_check import contradicted_by_pair
from visual_servo_epipolar.core.twoview.observation import Observation

AHEAD = 0.5  # sine of the bearing up to which the goal is ahead or behind
KNOWN_PARALLAX = 3.0  # deviations of a parallax of which a metre shows a part


def check_motion(
    state: ServoState, observation: Observation | None, dt: float, settings: ServoSettings
) -> ServoState:
    """Return the state with its motion held against commands; contradictions undo learning."""
    measurement = state.measurement
    if observation is None or measurement is None or not state.phase.runs:
        return state if state.check.reference is None else state.changed(check=MotionCheck())
    if dt == 0.0:
        return state.changed(check=state.check.restarted())
    shown = parallax_of_way(state, measurement, observation, settings)
    evidence = Evidence(observation, measurement.noise, shown)
    drives = state.phase.drives
    motion = state.check.updated(evidence, state.motion.sent, settings, drives=drives)
    leapt = motion.head.previous is None and state.check.head.previous is not None
    if leapt or motion.disturbed(measurement.stamp_ns):
        return _undone(state.changed(check=motion), measurement)
    if motion.reference is state.check.reference:
        return state.changed(check=motion)
    now = Known(state.map, state.identified)
    before = now if state.known is None else state.known[-1]
    return state.changed(check=motion, known=(before, now))


def check_lens(
    state: ServoState, observation: Observation | None, event: Event, settings: ServoSettings
) -> tuple[ServoState, Event]:
    """Return state and event: LOST where it would set off, but matches contradict the camera."""
    after = settings.machine.next_phase(state.phase, event)
    starts = state.phase in (Phase.WAITING, Phase.HOLDING) and after.drives
    retreats = after.backs_off and not state.phase.backs_off
    if not (starts or retreats) or observation is None or state.measurement is None:
        return state, event
    trouble, _ = contradicted_by_pair(observation, settings)
    if not trouble:
        return state, event
    measurement = replace(state.measurement, reason=trouble)
    return state.changed(measurement=measurement, reason=trouble, settled=0), Event.LOST


def _undone(state: ServoState, measurement: GoalEstimate) -> ServoState:
    """Return ``state`` as known before a motion that contradicts commands, and the reason."""
    trouble = state.check.trouble
    if trouble:
        state = state.changed(measurement=replace(measurement, reason=trouble))
    if state.phase is Phase.HOLDING:
        state = state.changed(settled=0, reason=trouble or state.reason)
    if state.known is None:
        return state
    before, identified = state.known[0]
    lost_map = replace(before, views=None, place=None)  # the way since is unknown
    extrinsics, pose = identified.extrinsics, state.identified.odometry.pose
    identified = replace(
        identified,
        dead_band=state.identified.dead_band,
        extrinsics=extrinsics and replace(extrinsics, placed=False),
        odometry=replace(identified.odometry, check=None, pose=pose),
    )
    goal = replace(state.goal, map=lost_map)
    return state.changed(goal=goal, identified=identified, leg=None)


def parallax_of_way(
    state: ServoState, measurement: GoalEstimate, observation: Observation, settings: ServoSettings
) -> float:
    """
    Return what a metre driven shows of parallax [rad/m]; 0 where unknown.

    A way to the goal shows as large a part of its parallax as it is of the distance, and less from
    afar, where the scene looks small; one to where the camera looks, with the goal aside, as much
    less as features are near the axis. A distance that is not known is as large as it may be.
    """
    noise, parallax = NOISE_OF_PARALLAX * measurement.noise, measurement.parallax
    if not parallax > KNOWN_PARALLAX * noise or not len(observation):
        return 0.0
    distance = measurement.distance()
    most = settings.initial_distance + state.motion.reversed
    distance = min(distance, most) if distance > 0.0 else math.inf
    shown = math.sqrt(parallax * parallax - noise * noise) / max(distance, settings.min_distance)
    now, photographed = (
        median(np.hypot(*(rays[:, :2] - np.median(rays[:, :2], axis=0)).T))
        for rays in (observation.current, observation.desired)
    )
    shown *= min(now / photographed, 1.0) if photographed > 0.0 else 1.0
    bearings = measurement.bearings
    if bearings is not None and abs(math.sin(bearings.alpha)) < AHEAD:
        return shown
    return shown * median(np.hypot(observation.current[:, 0], observation.current[:, 1]))
