"""States of a servo at a standstill, and sights of it, for tests of single steps."""

from dataclasses import replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics, PSI, RHO, YAW
from visual_servo_epipolar.core.estimate.goal_estimate import goal_estimate, GoalEstimate
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.two_steps import TWO_STEPS
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import advance
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

SETTINGS = ServoSettings(law='full')
START = ServoState()
KEPT = 'jitter', 'trusted_heading'  # which an estimate takes over from the one before
TWO_VIEWS = ServoSettings(law='full', memory=False)  # who has no memory of views never doubts
MEMORY = fresh_memory(SETTINGS)
PHASES = tuple(TWO_STEPS.rows)
DRIVING = tuple(phase for phase in PHASES if phase.drives)
ENDED = tuple(phase for phase in PHASES if phase.ended)
EVENTS = tuple(value for value in vars(Event).values() if isinstance(value, Event))
STEPS = (Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES)
BEARINGS = Bearings(math.atan2(-1.0, math.tan(0.3)), math.atan2(math.tan(0.2), -1.0))


def sight(frame: int = 1, *, bearings: Bearings | None = BEARINGS, **changes: Any) -> Measurement:
    """Return a good measurement at a tenth of a second per ``frame``, far from the goal."""
    good = Measurement(
        frame * 100_000_000,
        40,
        769.0,
        0.3,
        bearings=bearings,
        deviation=1e-3,
        confidence=0.9,
        inliers=38,
        parallax=30.0 / 769.0,
        heading_error=0.1 if bearings is None else bearings.heading_error,
        difference=-0.1,
        feature_error=60.0 / 769.0,
    )
    return replace(good, **changes)


def behind(chi: float, alpha: float) -> Bearings:
    """Return bearings from behind the goal: of e_du, left positive, and of e_au."""
    return Bearings(math.atan2(-1.0, math.tan(chi)), math.atan2(math.tan(alpha), -1.0))


def reading(
    deviation: float = 1e-3,
    *,
    lateral: float = 0.004,
    longitudinal: float = -0.5,
    heading_error: float = 0.01,
    lateral_deviation: float | None = None,
    pose_covariance: FloatArray | None = None,
    **changes: Any,
) -> MapLocalization:
    """Return what a memory of views says of a place; bearings are known to ``deviation``."""
    aside = deviation * math.hypot(lateral, longitudinal)
    covariance = np.diag([lateral_deviation or aside, aside, 1e-6, 0.0, 0.0]) ** 2
    if pose_covariance is not None:
        covariance[:3, :3] = pose_covariance
    said = MapLocalization(
        pose=np.array([lateral, longitudinal, heading_error, 0.0, 0.0]),
        covariance=covariance,
        own=np.diag([1e-4, 1e-4, 1e-5, 0.0, 0.0]) ** 2,
        geometry=None,
        inliers=np.ones(50, bool),
        shift=np.zeros(5),
        difference_slope=0.04,
    )
    return replace(said, **changes)


def ranged(distance: float = 3.0, *, deviation: float = 0.1, **changes: Any) -> Extrinsics:
    """Return a belief that knows the distance [m], of a robot that stands where `sight` is."""
    known = SETTINGS.extrinsics
    mean, covariance = known.mean.copy(), known.covariance.copy()
    mean[PSI], mean[RHO] = BEARINGS.psi, math.log(distance)
    covariance[PSI, PSI], covariance[RHO, RHO] = 1e-6, deviation**2
    place = {'heading': BEARINGS.heading_error, 'placed': True}
    return replace(known, **{'mean': mean, 'covariance': covariance, **place, **changes})


def learnt_yaw(degrees: float) -> Extrinsics:
    """Return a belief that the camera is turned by ``degrees`` on the base."""
    mean = ranged().mean.copy()
    mean[YAW] = math.radians(degrees)
    return ranged(mean=mean, believed=True)


def in_phase(phase: Phase, **changes: Any) -> ServoState:
    """Return a state at time zero in ``phase``, as a run would have it, at a standstill."""
    running = {'measurement': sight(0), 'distance': 8.0, 'side': -1.0, 'target': 0.2}
    return seeing(ServoState(), phase=phase, **{**running, 'mount': np.zeros(3), **changes})


def goal(seen: Measurement, state: ServoState = START) -> GoalEstimate:
    """Return the estimate of the goal by what is ``seen``, and what a ``state`` has."""
    known, before, memory = state.identified, state.measurement, state.view.memory
    kept = {name: getattr(before, name) for name in KEPT if hasattr(before, name)}
    return goal_estimate(
        seen,
        None,
        known.extrinsics or SETTINGS.extrinsics,
        known.base,
        place=state.map.place,
        motion=state.motion,
        period=state.view.period,
        followed=None if memory is None else memory.rivals,
        **kept,
    )


def seeing(state: ServoState, **changes: Any) -> ServoState:
    """Return ``state`` with changes, and the estimate of the goal by its parts."""
    known = {name: changes.pop(name) for name in KEPT if name in changes}
    state = state.changed(**changes)
    if state.measurement is not None or known:
        now = replace(goal(state.measurement or sight(0), state), **known)
        state = state.changed(measurement=now)
    rest = state.settling.rest
    return state if rest is None else state.changed(rest=goal(rest, state))


def asked(question: Any, state: ServoState, seen: Measurement, settings: ServoSettings) -> Any:
    """Return what a function of laws answers in a ``state`` where that is ``seen``."""
    return question(goal(seen, state), state, settings)


def estimated(state: ServoState) -> ServoState:
    """Return ``state`` with the estimate of the goal by its parts."""
    return seeing(state, measurement=state.measurement or sight(0))


def then(
    state: ServoState, measurement: Measurement | None = None, settings: ServoSettings = SETTINGS
) -> ServoState:
    return advance(state, Perception(measurement or sight(), MEMORY), settings)
