"""Ramps go by the time between commands as well; limits of speed by the part set on the way."""

from dataclasses import replace
from itertools import pairwise
import math

import pytest
from servo_states import behind, seeing, sight

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import _limited, advance, LATE_S
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

SETTINGS = ServoSettings()
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


def test_lowered_on_the_way_it_is_reached_by_the_ramps() -> None:
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
def test_it_is_a_part(ratio: float) -> None:
    with pytest.raises(ValueError, match='max_speed_ratio'):
        replace(SETTINGS, max_speed_ratio=ratio)
