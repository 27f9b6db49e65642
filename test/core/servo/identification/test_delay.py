"""Delay of a base: learnt from turns that come late, and from nothing else."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import SETTINGS, sight

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.commands_sent import CommandsSent
from visual_servo_epipolar.core.servo.identification.delay import (
    BORNE,
    Delay,
    LEAST_IMAGES,
    MOST_DEVIATION,
)

NOISE = 5e-4  # [rad]


def learnt(
    delay: float,
    *,
    gain: float = 1.0,
    period: float = 0.1,
    noise: float = NOISE,
    speed: float = 0.4,
    images: int = 80,
    told: float = 0.1,
    deviation: float = 1e-3,
    disturbed: float = 0.0,
) -> Delay:
    """Return what turns to and fro tell of a base that obeys late, and ``gain`` times as much."""
    rng = np.random.default_rng(1)
    settings = replace(SETTINGS, latency=told)
    known, commands, heading = Delay(), CommandsSent(), 0.3
    before: Measurement | None = None
    for k in range(images):
        stamp_ns = round(k * period * 1e9)
        if before is not None:
            heading += gain * commands.turns(before.stamp_ns, stamp_ns, np.array([delay]))[0]
            heading += disturbed * rng.normal()
        seen = replace(
            sight(), stamp_ns=stamp_ns, heading_error=heading + noise * rng.normal(),
            offset=(0.0, -1.0), heading_deviation=deviation,
        )  # fmt: skip
        known = known.updated(before, seen, commands, settings)
        commands = commands.after(stamp_ns, Twist(0.2, speed * math.sin(k * period * 2.0)))
        before = seen
    return known


@pytest.mark.parametrize('period', [1 / 30, 1 / 11, 0.2])
@pytest.mark.parametrize('delay', [0.35, 0.5, 0.83, 1.2])
def test_a_base_that_obeys_late_is_found_out(delay, period) -> None:
    images = round(8.0 / period)
    assert learnt(delay, period=period, images=images).value == pytest.approx(delay, abs=0.05)


@pytest.mark.parametrize('gain', [0.75, 1.3])
def test_worn_wheels_have_their_delay_as_well(gain) -> None:
    assert learnt(0.5, gain=gain).value == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize('delay', [0.0, 0.1, BORNE])
def test_what_laws_bear_is_left_alone(delay) -> None:
    assert learnt(delay).value == 0.0


@pytest.mark.parametrize(
    'change',
    [
        {'images': LEAST_IMAGES - 1},
        {'speed': 0.01},  # too little
        {'noise': 0.05},
        {'disturbed': 0.05},  # somebody turns the robot
        {'gain': 0.3},  # a wheel in the air
        {'gain': -1.0},
        {'deviation': 1.1 * MOST_DEVIATION},
        {'told': 0.5},
    ],
    ids=str,
)
def test_what_is_not_certain_is_not_learnt(change) -> None:
    assert learnt(0.5, **change).value == 0.0


def test_headings_by_other_views_tell_no_turn() -> None:
    one = sight(1, heading_deviation=1e-4)
    other = sight(2, heading_deviation=1e-4, remembered=True, heading_error=0.5)
    commands = CommandsSent().after(one.stamp_ns, Twist(0.0, 1.0))
    assert Delay().updated(one, other, commands, SETTINGS).images == 0
    late = replace(other, remembered=False, stamp_ns=one.stamp_ns + 10**10)
    assert Delay().updated(one, late, commands, SETTINGS).images == 0


def test_what_is_learnt_is_gone_by_unless_a_longer_one_is_told() -> None:
    known = Delay(0.5)
    assert known.beside(SETTINGS).latency == 0.5
    told = replace(SETTINGS, latency=0.8)
    assert known.beside(told) is told
    alone = replace(SETTINGS, law='full-anticipation')
    assert known.beside(alone) is alone
