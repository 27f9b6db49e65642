"""What is learnt of the mount changes the run; a geometry that driving disproves is given up."""

from dataclasses import replace
import math

from mounted import of_camera_axes
import numpy as np
import pytest
from servo_states import (
    BEARINGS,
    in_phase,
    learnt_yaw,
    MEMORY,
    ranged,
    SETTINGS,
    sight,
    STEPS,
    then,
    TWO_VIEWS,
)

from visual_servo_epipolar.core.estimate.extrinsics import (
    CORRELATION,
    MAX_CONTRADICTIONS,
    moved,
    PSI,
    update_extrinsics,
    YAW,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.memory import yaw_learnt
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.legs import Leg
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import advance
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.perceive import Perception


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
    assert repr(state.view.memory) == repr(MEMORY)
    assert state.identified.extrinsics is SETTINGS.extrinsics
    assert state.measurement.bearings is None


def test_a_bearing_that_driving_explains_is_no_contradiction() -> None:
    turned = Bearings(BEARINGS.psi, BEARINGS.phi - 0.1)
    state = then(contradicted(Phase.ZEROING_EPIPOLES), sight(bearings=turned))
    assert state.phase is not Phase.HOLDING
    assert state.identified.extrinsics.contradictions == MAX_CONTRADICTIONS - 1


NEAR_ZERO = 0.05  # abscissa at which e_au is held: the spiral ends too near the goal


def test_step_1_begins_anew_where_the_yaw_turns_out_to_be_another() -> None:
    """But where the spiral of the e_au that it holds leads home, it goes on."""
    zeroing = in_phase(Phase.ZEROING_EPIPOLES, extrinsics=learnt_yaw(1.6), target=NEAR_ZERO)
    assert then(zeroing.changed(target=0.3)).phase is zeroing.phase
    paper = then(zeroing.changed(target=0.3), sight(), replace(SETTINGS, law='corrected'))
    assert paper.phase is Phase.DISPLACING
    state = then(zeroing)
    assert (state.phase, state.reason) == (Phase.DISPLACING, 'escaped')
    assert state.run.mount[0] == pytest.approx(math.radians(1.6))
    assert yaw_learnt(state.measurement, state) == 0.0
    assert then(zeroing.changed(extrinsics=learnt_yaw(1.4))).phase is zeroing.phase


@pytest.mark.parametrize(
    'why', [{'extrinsics': learnt_yaw(1.6), 'target': NEAR_ZERO}, {'latched': True}]
)
def test_too_near_the_goal_step_1_backs_off_before_it_begins_anew(why) -> None:
    near = sight(difference=-0.9 * SETTINGS.retreat_difference)
    zeroing = in_phase(Phase.ZEROING_EPIPOLES, **why)
    assert then(zeroing).phase is Phase.DISPLACING
    assert then(zeroing, near).phase is Phase.RETREATING
    bare = replace(SETTINGS, retreat=False)
    assert then(zeroing, near, bare).phase is Phase.DISPLACING


@pytest.mark.parametrize(
    ('degrees', 'attempts', 'phase'),
    [
        (0.6, 1, Phase.RETREATING),
        (0.4, 1, Phase.ARRIVED),
        (2.0, SETTINGS.max_attempts, Phase.ARRIVED),  # it never fails for it
    ],
)
def test_step_2_by_a_wrong_yaw_is_another_attempt(degrees, attempts, phase) -> None:
    at_goal = {'parallax': 1e-5, 'difference': 0.0, 'heading_error': 0.0, 'feature_error': 1e-5}
    matching = in_phase(
        Phase.MATCHING_FEATURES,
        extrinsics=learnt_yaw(degrees),
        settled=SETTINGS.arrival_frames,
        settled_parallax=1e-5,
        attempts=attempts,
    )
    state = then(matching, sight(bearings=None, **at_goal), TWO_VIEWS)
    assert state.phase is phase
    assert state.run.attempts == attempts + (phase is Phase.RETREATING)


def test_a_camera_off_the_axle_gives_the_bearings_of_the_axle() -> None:
    settings = replace(SETTINGS, camera_yaw=0.1, camera_forward=0.3)
    state = then(ServoState(), sight(), settings)
    assert state.measurement.camera_bearings == BEARINGS
    assert state.measurement.seen_bearings == BEARINGS
    mount = of_camera_axes(np.array([0.1, 0.3, 0.0]))
    expected = at_axle(BEARINGS, mount, state.identified.extrinsics.distance)
    found = state.measurement.bearings
    assert (found.psi, found.phi) == pytest.approx((expected.psi, expected.phi))


@pytest.mark.parametrize(
    ('latency', 'travel'), [(0.0, 0.03), (0.05, 0.02), (0.1, 0.01), (0.4, 0.01)]
)
def test_travel_is_that_of_commands_which_act_late(latency: float, travel: float) -> None:
    settings = replace(SETTINGS, latency=latency, anticipation=False)
    state = in_phase(
        Phase.ZEROING_EPIPOLES, command=Command(Twist(0.3, 0.0)), last_linear=0.1, travel=1.0
    )
    after = then(state, settings=settings)
    assert after.phase is state.phase
    assert after.run.travel == pytest.approx(1.0 + travel)
    assert after.motion.last_linear == 0.3


def test_a_leg_by_another_mount_is_forgotten() -> None:
    mean = ranged(2.0).mean.copy()
    mean[YAW] = 0.2
    covariance = np.diag([1e-6, 0.01, 1e-4, 1e-4, 1e-4])
    known = ranged(mean=mean, covariance=covariance, travel=0.05)
    state = in_phase(Phase.DISPLACING, extrinsics=known, leg=Leg(0.3, 0.4))
    after = then(state)
    assert after.identified.extrinsics.believed
    assert after.law.leg is None


def test_a_belief_survives_where_nothing_is_seen() -> None:
    blind = Measurement(100_000_000, 3, 769.0, 0.3, reason='3 features, 12 needed')
    state = then(in_phase(Phase.ZEROING_EPIPOLES, extrinsics=learnt_yaw(2.0)), blind)
    assert state.phase is Phase.HOLDING
    assert state.identified.extrinsics.mount[0] == pytest.approx(math.radians(2.0))


@pytest.mark.parametrize(('count', 'contradicts'), [(12, False), (13, True)])
def test_more_than_twelve_contradictions_disprove_a_geometry(count, contradicts) -> None:
    assert ranged(contradictions=count).contradicts == contradicts


@pytest.mark.parametrize(('deviations', 'faults'), [(5.9, 0), (6.1, 5)])
def test_a_bearing_six_deviations_off_begins_the_path_anew(deviations: float, faults: int) -> None:
    before, deviation, heading = ranged(), 0.01, BEARINGS.heading_error
    there = moved(replace(before, travel=0.05), heading)
    variance = there.covariance[PSI, PSI] + CORRELATION * deviation**2
    psi = float(there.mean[PSI]) + deviations * math.sqrt(variance)
    odd = sight(bearings=Bearings(psi, psi - BEARINGS.psi + BEARINGS.phi), deviation=deviation)
    after = update_extrinsics(before, odd, 0.05, missed=False)
    assert after.contradictions == faults
