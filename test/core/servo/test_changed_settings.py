"""Settings changed while the robot drives hold from the next command on; ramps go by its time."""

from dataclasses import replace
from itertools import pairwise
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import behind, DRIVING, in_phase, seeing, SETTINGS, sight, then
from strategies import floats

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import _limited, advance, LATE_S, nominal_twist
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

DERIVED = ServoSettings(gains='derived', law='full')
ALIGNED = Bearings(-math.pi / 2.0, math.pi)
STEPS = (Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES)


@given(
    phase=st.sampled_from(DRIVING),
    last=st.builds(Twist, floats(-0.4, 0.4), floats(-0.5, 0.5)),
    max_linear=floats(0.01, 0.4),
    max_angular=floats(0.01, 0.5),
)
def test_a_limit_lowered_while_driving_holds_at_once(phase, last, max_linear, max_angular) -> None:
    lowered = replace(SETTINGS, max_linear=max_linear, max_angular=max_angular)
    twist = then(in_phase(phase, command=Command(last)), settings=lowered).twist
    assert abs(twist.linear) <= max_linear * (1.0 + 1e-15)
    assert abs(twist.angular) <= max_angular * (1.0 + 1e-15)


def begun(settings: ServoSettings, phase: Phase) -> ServoState:
    """Return a state in ``phase`` whose gains were derived as it began."""
    if phase is Phase.ZEROING_EPIPOLES:
        return then(in_phase(Phase.DISPLACING, target=0.2, period=0.1), sight(), settings)
    zeroed = {'latched': True, 'settled': SETTINGS.align_frames, 'period': 0.1}
    seen = sight(bearings=ALIGNED, difference=-0.005)
    return then(in_phase(Phase.ZEROING_EPIPOLES, **zeroed), seen, settings)


@pytest.mark.parametrize('phase', STEPS)
def test_given_gains_hold_as_soon_as_derived_ones_are_given_up(phase: Phase) -> None:
    state = begun(DERIVED, phase)
    assert state.phase is phase
    assert state.law.gains is not None
    given_up = replace(DERIVED, gains='given')
    fresh = state.changed(gains=None)
    assert nominal_twist(state, given_up) == nominal_twist(fresh, given_up)
    assert nominal_twist(state, given_up) != nominal_twist(state, DERIVED)


def test_gains_that_were_given_up_are_not_taken_up_again_by_the_next_phase() -> None:
    state = then(
        begun(DERIVED, Phase.ZEROING_EPIPOLES).changed(settled=9, latched=True),
        sight(2, bearings=ALIGNED),
        replace(DERIVED, gains='given'),
    )
    assert (state.phase, state.law.gains) == (Phase.MATCHING_FEATURES, None)


def test_a_focal_length_is_not_left_to_an_estimator_that_cannot_learn_it() -> None:
    with pytest.raises(ValueError, match=r'with estimator lmeds_8pt, .* got 0\.3; soft_planar'):
        PerceptionSettings(estimator='lmeds_8pt', focal_deviation=0.3)
    assert PerceptionSettings(estimator='lmeds_8pt').calibrated
    assert not PerceptionSettings(focal_deviation=0.3).calibrated


DRIVEN = Command(Twist(0.02, 0.0))
SEEN = sight(0, bearings=behind(0.0, 0.0))


def speed(seconds: float, since_command: float, command: Command = DRIVEN) -> float:
    """Return the speed commanded by an image so many ``seconds`` after the last, in step 2."""
    state = seeing(
        ServoState(),
        phase=Phase.MATCHING_FEATURES,
        measurement=SEEN,
        distance=3.0,
        period=0.1,
        command=command,
    )
    sight = Perception(replace(SEEN, stamp_ns=round(seconds * 1e9)), fresh_memory(SETTINGS))
    return advance(state, sight, SETTINGS, since_command=since_command).twist.linear


@pytest.mark.parametrize('since_command', [0.0, 0.05, 0.3])
def test_stamps_that_are_farther_apart_than_commands_give_no_speed(since_command: float) -> None:
    rise = SETTINGS.max_acceleration * (since_command + LATE_S)
    assert speed(0.4, since_command) == pytest.approx(0.02 + rise)
    started = speed(0.4, 0.01, Command(STANDSTILL))  # a start counts it too
    assert started == pytest.approx(SETTINGS.max_acceleration * (0.01 + LATE_S))


@pytest.mark.parametrize('since_command', [math.nan, math.inf, 0.1, 0.1 - LATE_S, 7.0])
def test_commands_in_time_go_by_stamps(since_command: float) -> None:
    assert speed(0.1, since_command) == 0.02 + SETTINGS.max_acceleration * 0.1


def test_the_time_is_told_for_replays() -> None:
    state = seeing(ServoState(), phase=Phase.MATCHING_FEATURES, measurement=SEEN, distance=8.0)
    sight = Perception(replace(SEEN, stamp_ns=10**8), fresh_memory(SETTINGS))
    told = telemetry(advance(state, sight, SETTINGS, since_command=0.07))
    assert told['since_command_s'] == 0.07


# A part of the speeds, set on the way: the robot slows down by its ramps, on the same path.
DT = 0.1
DRIVES = ServoState().changed(phase=Phase.ZEROING_EPIPOLES)


def test_a_part_of_the_speeds_that_is_lowered_on_the_way_is_reached_by_the_ramps() -> None:
    settings = replace(SETTINGS, max_speed_ratio=0.25)
    twist = Twist(SETTINGS.max_linear, 0.0)
    speeds = [twist.linear]
    while speeds[-1] > 0.1 + 1e-9:
        twist = _limited(Twist(2.0, 0.0), twist, DT, DRIVES, settings)
        speeds.append(twist.linear)
    steps = [before - after for before, after in pairwise(speeds)]
    assert max(steps) <= 2.0 * SETTINGS.max_acceleration * DT + 1e-9
    assert len(steps) == pytest.approx(0.3 / (2.0 * SETTINGS.max_acceleration * DT), abs=1.0)
    assert speeds[-1] == pytest.approx(0.25 * SETTINGS.max_linear)


@pytest.mark.parametrize('ratio', [0.0, 1.01, -0.5])
def test_a_part_of_the_speeds_is_above_0_and_at_most_1(ratio: float) -> None:
    with pytest.raises(ValueError, match='max_speed_ratio'):
        replace(SETTINGS, max_speed_ratio=ratio)
