"""Delay of a base: learnt from turns that come late, and from nothing else."""

from collections.abc import Callable
from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import SETTINGS, sight

from visual_servo_epipolar.core.estimate.base_model import Delay, MOST_DEVIATION
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.prediction import BORNE, felt_latency, is_late
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.servo.settings import ServoSettings

NOISE = 5e-4  # [rad]
To = Callable[[float], float]


def to_and_fro(speed: float = 0.4) -> To:
    """Return what is commanded by time: turns of three seconds, with rests."""
    return lambda t: speed * math.sin(2.0 * t) if math.sin(0.3 * t + 0.5) > -0.5 else 0.0


def learnt(
    delay: float,
    *,
    known: Delay | None = None,
    told: ServoSettings = SETTINGS,
    command: To | None = None,
    gain: float = 1.0,
    rate: float = 10.0,
    noise: float = NOISE,
    seconds: float = 10.0,
    deviation: float = 1e-3,
    deaf_s: float = 0.0,
    push: float = 0.0,
    disturbed: float = 0.0,
    moved: Callable[[float], float] | None = None,
) -> Delay:
    """
    Return what turns tell of a base that obeys late, and ``gain`` times as much.

    It is deaf for ``deaf_s`` first, ``moved`` [s] is its delay by time, ``push`` [rad] turns it
    at once after 2 s, ``disturbed`` [rad] in each image.
    """
    rng = np.random.default_rng(1)
    known, commands, heading, last_ns = known or Delay(), CommandsSent(), 0.3, 0
    command = command or to_and_fro()
    for k in range(round(seconds * rate)):
        now_ns = round(k / rate * 1e9)
        late = moved(k / rate) if moved else delay
        turn = commands.turns(last_ns, now_ns, np.array([late]))[0] if k else 0.0
        heading += gain * turn * (k / rate > deaf_s) + disturbed * rng.normal()
        heading += push * (k == round(2.0 * rate))
        seen = {'heading_error': heading + noise * rng.normal(), 'heading_deviation': deviation}
        seen = replace(sight(), stamp_ns=now_ns, offset=(0.0, -1.0), **seen)
        known = known.updated(seen, commands, told)
        commands = commands.after(now_ns, Twist(0.2, command(k / rate)))
        last_ns = now_ns
    return known


@pytest.mark.parametrize('rate', [5.0, 15.0, 30.0, 60.0])
@pytest.mark.parametrize('delay', [0.35, 0.4, 0.5, 0.83, 1.2])
def test_a_base_that_obeys_late_is_found_out(delay, rate) -> None:
    assert learnt(delay, rate=rate).value == pytest.approx(delay, abs=0.06)


@pytest.mark.parametrize(
    'change',
    [{'gain': 0.75}, {'gain': 1.3}, {'push': 0.5}, {'deaf_s': 8.0, 'seconds': 40.0}],
    ids=str,
)
def test_wheels_that_are_worn_a_push_or_a_hold_hide_it_not_for_long(change) -> None:
    assert learnt(0.5, **{'seconds': 20.0, **change}).value == pytest.approx(0.5, abs=0.06)


def test_laws_look_ahead_by_the_best_guess_before_it_is_certain() -> None:
    soon = learnt(0.35, seconds=1.4, rate=15.0)
    assert soon.value == 0.0
    late = soon.beside(SETTINGS)
    assert is_late(late)
    assert late.latency == pytest.approx(0.35, abs=0.06)
    assert learnt(0.1, seconds=1.4, rate=15.0).beside(SETTINGS) is SETTINGS


def test_turns_that_a_dead_band_swallows_tell_no_delay() -> None:
    """They would hide for long that turns come late."""
    seen, commands = replace(sight(), heading_deviation=1e-3, offset=(0.0, -1.0)), CommandsSent()
    known = Delay()
    for k in range(100):
        known = known.updated(replace(seen, stamp_ns=k * 10**8), commands, SETTINGS)
        commands = commands.after(k * 10**8, Twist(0.2, 0.06))
    assert not known.sums.any()


@pytest.mark.parametrize('delay', [0.0, 0.1, BORNE])
def test_what_laws_bear_is_left_alone(delay) -> None:
    assert learnt(delay).value == 0.0


@pytest.mark.parametrize('deaf_s', [0.5, 0.7, 0.9, 1.2])
def test_a_base_that_only_begins_late_is_not_late(deaf_s) -> None:
    """Brakes that open, a hand: a step that it misses the beginning of, then it obeys at once."""
    once = learnt(0.1, deaf_s=deaf_s, command=lambda t: 0.5, seconds=3.0)
    assert once.value == 0.0
    turns = learnt(0.1, deaf_s=deaf_s, command=lambda t: 0.5 if t < 3.0 else 0.0, seconds=8.0)
    assert turns.value == 0.0
    assert turns.beside(SETTINGS) is SETTINGS


@pytest.mark.parametrize(('first', 'then'), [(1.0, 0.5), (0.5, 1.0), (0.6, 0.1), (0.8, 0.85)])
def test_what_was_learnt_wrong_is_learnt_anew(first, then) -> None:
    expected = pytest.approx(then, abs=0.06) if then > BORNE else 0.0
    assert learnt(then, known=Delay(first), seconds=25.0).value == expected
    after = learnt(0.0, moved=lambda t: first if t < 15.0 else then, seconds=60.0)
    assert after.value == expected


@pytest.mark.parametrize(
    'change',
    [
        {'seconds': 0.8},
        {'command': to_and_fro(0.01)},  # too little
        {'noise': 0.05},
        {'disturbed': 0.05},  # somebody turns the robot
        {'gain': 0.3},  # a wheel in the air
        {'gain': -1.0},
        {'deviation': 1.1 * MOST_DEVIATION},
        {'told': replace(SETTINGS, latency=0.5)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_what_is_not_certain_is_not_learnt(change) -> None:
    assert learnt(0.5, **change).value == 0.0


def test_headings_by_other_views_tell_no_turn() -> None:
    commands = CommandsSent().after(0, Twist(0.0, 1.0))
    one = sight(1, heading_deviation=1e-4)
    began = Delay().updated(one, commands, SETTINGS)
    assert (began.heading, began.energy) == (one.heading_error, 0.0)
    turned = sight(2, heading_deviation=1e-4, heading_error=one.heading_error + 0.05)
    assert began.updated(turned, commands, SETTINGS).energy > 0.0
    by_memory = replace(turned, offset=(0.0, -1.0))
    assert began.updated(by_memory, commands, SETTINGS).energy == 0.0
    late = replace(turned, stamp_ns=one.stamp_ns + 10**10)
    assert began.updated(late, commands, SETTINGS).energy == 0.0


def test_what_is_learnt_is_gone_by_unless_a_longer_one_is_told() -> None:
    known = Delay(0.5)
    late = known.beside(SETTINGS)
    assert late.latency == 0.5
    assert is_late(late)
    assert felt_latency(late) == BORNE
    told = replace(SETTINGS, latency=0.8)
    assert known.beside(told) is told
    alone = replace(told, anticipation=False)
    assert known.beside(alone) is alone
    assert not is_late(alone)
    assert felt_latency(alone) == 0.8
