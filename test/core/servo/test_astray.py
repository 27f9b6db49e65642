"""No phase leads farther than it may, and a geometry that driving disproves is given up."""

from dataclasses import replace
import math
from typing import Any

import numpy as np
import pytest
from strategies import CAMERA, matches

from visual_servo_epipolar.core.control.command import Command
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import fresh_memory
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.servo.extrinsics import (
    at_axle,
    Extrinsics,
    MAX_CONTRADICTIONS,
    PSI,
    RHO,
    YAW,
)
from visual_servo_epipolar.core.servo.phases.conditions import astray
from visual_servo_epipolar.core.servo.phases.events import classify
from visual_servo_epipolar.core.servo.phases.table import DRIVING, Event, Phase
from visual_servo_epipolar.core.servo.ranging import Leg
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import advance, step

SETTINGS = ServoSettings()
MEMORY = fresh_memory(SETTINGS)
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
    return ServoState(phase=phase, **{**running, 'mount': np.zeros(3), **changes})


def then(
    state: ServoState, measurement: Measurement | None = None, settings: ServoSettings = SETTINGS
) -> ServoState:
    return advance(state, Perception(measurement or sight(), MEMORY), settings)


# Backing off


def test_who_backs_off_too_far_fails_and_says_so() -> None:
    state = then(in_phase(Phase.RETREATING, travel=-10.01))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == 'backed off by 10.0 m (max_retreat), the goal is still not ahead'


@pytest.mark.parametrize('travel', [-9.99, 10.01])
def test_backing_off_may_take_that_long(travel: float) -> None:
    assert then(in_phase(Phase.RETREATING, travel=travel)).phase is not Phase.FAILED


def test_the_bound_of_backing_off_is_a_setting_and_counts_what_was_driven() -> None:
    settings = replace(SETTINGS, max_retreat=0.5)
    sideways = sight(bearings=Bearings(-0.3, -0.3 - math.pi / 2.0), difference=0.1)
    state = in_phase(Phase.RETREATING, measurement=replace(sideways, stamp_ns=0))
    for frame in range(1, 60):
        state = then(state, replace(sideways, stamp_ns=frame * 100_000_000), settings)
        if state.phase is Phase.FAILED:
            break
    assert state.reason.startswith('backed off by 0.5 m (max_retreat)')
    # 0.2 m/s from a standstill: not before 2.5 s.
    assert 26 <= state.frame <= 35


# The longest way


@pytest.mark.parametrize('phase', STEPS)
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_no_way_is_longer_than_the_distance_allows(phase: Phase, sign: float) -> None:
    settings = replace(SETTINGS, initial_distance=4.0)
    state = then(in_phase(phase, travel=sign * 6.01), settings=settings)
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == f'drove 6 m in {phase.value} and is not there (initial_distance)'
    assert then(in_phase(phase, travel=sign * 5.99), settings=settings).phase is not Phase.FAILED


@pytest.mark.parametrize('phase', [Phase.ORIENTING, Phase.DISPLACING, Phase.RETREATING])
def test_other_phases_have_no_longest_way(phase: Phase) -> None:
    assert astray(in_phase(phase, travel=1e3), sight(), SETTINGS) == ''


# The excursion


def off(ratio: float, phase: Phase = Phase.ZEROING_EPIPOLES, **changes: Any) -> ServoState:
    """Return a state that is ``ratio`` times as far off as where its leg began."""
    distance = 3.0
    x, y = (distance * (1.0 - 1.0 / ratio) * f(BEARINGS.psi) for f in (math.cos, math.sin))
    leg = Leg(BEARINGS.psi, x, y)
    return in_phase(phase, **{'leg': leg, 'extrinsics': ranged(distance), **changes})


@pytest.mark.parametrize('phase', STEPS)
def test_who_is_led_away_from_the_goal_fails_and_says_so(phase: Phase) -> None:
    state = then(off(1.4, phase))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == (
        f'{phase.value} leads away from the goal: 1.4 times the distance (max_excursion)'
    )
    assert then(off(1.29, phase)).phase is not Phase.FAILED


def test_the_bound_of_the_excursion_is_a_setting() -> None:
    assert then(off(1.29), settings=replace(SETTINGS, max_excursion=1.28)).phase is Phase.FAILED
    assert then(off(2.0), settings=replace(SETTINGS, max_excursion=2.1)).phase is not Phase.FAILED


@pytest.mark.parametrize(
    'changes',
    [
        {'leg': None},
        {'extrinsics': None},
        {'extrinsics': ranged(deviation=0.26)},
        {'phase': Phase.RETREATING},
        {'phase': Phase.DISPLACING},
    ],
    ids=['no leg', 'no belief', 'not ranged', 'backing off', 'displacing'],
)
def test_a_distance_that_is_not_known_leads_nobody_astray(changes: dict[str, Any]) -> None:
    assert astray(off(2.0), sight(), SETTINGS) != ''
    assert astray(replace(off(2.0), **changes), sight(), SETTINGS) == ''


def test_without_bearings_nobody_is_astray() -> None:
    assert astray(off(2.0), sight(bearings=None), SETTINGS) == ''


def test_a_law_that_leads_away_by_itself_may_do_so() -> None:
    # Without retreat a law begins with concordant epipoles as well, and backs away.
    assert astray(off(2.0), sight(), replace(SETTINGS, law='full-retreat')) == ''


def test_near_the_goal_the_excursion_refers_to_half_a_metre() -> None:
    near = ranged(0.3)
    at_first = Leg(BEARINGS.psi, 0.29 * math.cos(BEARINGS.psi), 0.29 * math.sin(BEARINGS.psi))
    assert astray(off(2.0, leg=at_first, extrinsics=near), sight(), SETTINGS) == ''


@pytest.mark.parametrize('phase', DRIVING)
def test_every_driving_phase_ends_where_it_is_astray(phase: Phase) -> None:
    state = off(2.0, phase, travel=-1e3)
    state = replace(state, measurement=sight())
    bounded = phase is Phase.RETREATING or phase in STEPS
    assert (classify(state, SETTINGS) is Event.ASTRAY) == bounded


# Contradictions


def contradicted(phase: Phase) -> ServoState:
    """Return a state at which one more bearing off the path is too much."""
    return in_phase(phase, extrinsics=ranged(contradictions=MAX_CONTRADICTIONS))


# Where the robot has not gone: the line of sight turned by a radian while it turned by 0.1.
ELSEWHERE = Bearings(BEARINGS.psi + 1.0, BEARINGS.phi + 0.9)


@pytest.mark.parametrize('phase', [*STEPS, Phase.RETREATING, Phase.DISPLACING])
def test_bearings_that_driving_disproves_are_given_up(phase: Phase) -> None:
    learnt = replace(MEMORY, bearings=BEARINGS, noise=1.0)
    state = advance(contradicted(phase), Perception(sight(bearings=ELSEWHERE), learnt), SETTINGS)
    assert (state.phase, state.twist) == (Phase.HOLDING, STANDSTILL)
    assert state.reason == ('the bearings contradict what was driven; they are looked for anew')
    assert repr(state.memory) == repr(MEMORY)
    assert state.extrinsics is SETTINGS.extrinsics
    assert state.measurement is not None
    assert state.measurement.bearings is None


def test_features_that_driving_disproves_are_looked_at_anew() -> None:
    def observed(frame: int) -> Observation:
        return Observation(frame * 100_000_000, *matches(Pose(-1.0, -3.0, 1.6)), CAMERA.fx)

    state = step(contradicted(Phase.ZEROING_EPIPOLES), observed(1), SETTINGS)
    assert state.phase is Phase.HOLDING
    assert state.reason.startswith('the bearings contradict what was driven')
    assert step(state, observed(2), SETTINGS).phase is Phase.DISPLACING


def test_a_bearing_that_driving_explains_is_no_contradiction() -> None:
    turned = Bearings(BEARINGS.psi, BEARINGS.phi - 0.1)
    state = then(contradicted(Phase.ZEROING_EPIPOLES), sight(bearings=turned))
    assert state.phase is not Phase.HOLDING
    assert state.extrinsics is not None
    assert state.extrinsics.contradictions == MAX_CONTRADICTIONS - 1


# A yaw that is learnt on the way


def test_step_1_begins_anew_where_the_yaw_turns_out_to_be_another() -> None:
    zeroing = in_phase(Phase.ZEROING_EPIPOLES, extrinsics=learnt_yaw(1.6))
    state = then(zeroing)
    assert (state.phase, state.reason) == (Phase.DISPLACING, 'escaped')
    assert state.mount is not None
    assert state.mount[0] == pytest.approx(math.radians(1.6))
    assert state.yaw_learnt == 0.0
    assert then(replace(zeroing, extrinsics=learnt_yaw(1.4))).phase is zeroing.phase


def test_too_near_the_goal_step_1_backs_off_before_it_begins_anew() -> None:
    near = sight(difference=-0.9 * SETTINGS.retreat_difference)
    zeroing = in_phase(Phase.ZEROING_EPIPOLES, extrinsics=learnt_yaw(1.6))
    assert then(zeroing, near).phase is Phase.RETREATING
    bare = replace(SETTINGS, law='full-retreat')
    assert then(zeroing, near, bare).phase is Phase.DISPLACING


def test_an_epipole_that_escapes_near_the_goal_backs_off_as_well() -> None:
    escaped = in_phase(Phase.ZEROING_EPIPOLES, latched=True)
    near = sight(difference=-0.9 * SETTINGS.retreat_difference)
    assert then(escaped).phase is Phase.DISPLACING
    assert then(escaped, near).phase is Phase.RETREATING


@pytest.mark.parametrize(('degrees', 'phase'), [(0.6, Phase.RETREATING), (0.4, Phase.ARRIVED)])
def test_step_2_by_a_wrong_yaw_is_another_attempt(degrees: float, phase: Phase) -> None:
    at_goal = {'parallax': 1e-5, 'difference': 0.0, 'heading_error': 0.0, 'feature_error': 1e-5}
    matching = in_phase(
        Phase.MATCHING_FEATURES,
        extrinsics=learnt_yaw(degrees),
        settled=SETTINGS.arrival_frames,
        settled_parallax=1e-5,
    )
    state = then(matching, sight(bearings=None, **at_goal))
    assert state.phase is phase
    assert state.attempts == 1 + (phase is Phase.RETREATING)


def test_nothing_is_learnt_of_the_yaw_before_anything_is() -> None:
    assert ServoState().yaw_learnt == 0.0
    assert ServoState(extrinsics=learnt_yaw(2.0)).yaw_learnt == 0.0
    state = ServoState(extrinsics=learnt_yaw(-2.0), mount=np.zeros(3))
    assert state.yaw_learnt == pytest.approx(math.radians(2.0))


# The update by a measurement


def test_a_camera_off_the_axle_gives_the_bearings_of_the_axle() -> None:
    settings = replace(SETTINGS, camera_yaw=0.1, camera_forward=0.3)
    state = then(ServoState(), sight(), settings)
    assert state.measurement is not None
    assert state.extrinsics is not None
    assert state.measurement.camera_bearings == BEARINGS
    assert state.measurement.seen_bearings == BEARINGS
    expected = at_axle(BEARINGS, np.array([0.1, 0.3, 0.0]), state.extrinsics.distance)
    assert state.measurement.bearings == expected


def test_a_camera_on_the_axle_keeps_its_bearings_to_the_bit() -> None:
    state = then(ServoState())
    assert state.measurement is not None
    assert state.measurement.bearings is BEARINGS
    assert state.measurement.camera_bearings is None


@pytest.mark.parametrize(
    ('latency', 'travel'), [(0.0, 0.03), (0.05, 0.02), (0.1, 0.01), (0.4, 0.01)]
)
def test_travel_is_that_of_commands_which_act_late(latency: float, travel: float) -> None:
    settings = replace(SETTINGS, latency=latency)
    state = in_phase(
        Phase.ZEROING_EPIPOLES, command=Command(Twist(0.3, 0.0)), last_linear=0.1, travel=1.0
    )
    after = then(state, settings=settings)
    assert after.phase is state.phase
    assert after.travel == pytest.approx(1.0 + travel)
    assert after.last_linear == 0.3


def test_what_was_ranged_by_another_mount_is_forgotten() -> None:
    mean = ranged(2.0).mean.copy()
    mean[YAW] = 0.2
    covariance = np.diag([1e-6, 0.01, 1e-4, 1e-4, 1e-4])
    known = ranged(mean=mean, covariance=covariance, travel=0.05)
    state = in_phase(
        Phase.DISPLACING, extrinsics=known, range=5.0, leg=Leg(BEARINGS.psi, 0.3, 0.4)
    )
    after = then(state)
    assert after.extrinsics is not None
    assert after.extrinsics.believed
    assert after.leg is None
    assert after.range == pytest.approx(after.extrinsics.distance)
    again = then(replace(after, range=5.0), sight(2))
    assert again.range == pytest.approx(5.0)


def test_a_belief_survives_where_nothing_is_seen() -> None:
    blind = Measurement(100_000_000, 3, 769.0, 0.3, reason='3 features, 12 needed')
    state = then(in_phase(Phase.ZEROING_EPIPOLES, extrinsics=learnt_yaw(2.0)), blind)
    assert state.phase is Phase.HOLDING
    assert state.extrinsics is not None
    assert state.extrinsics.mount[0] == pytest.approx(math.radians(2.0))
