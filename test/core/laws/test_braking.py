"""Braking: turns in place are trapezoids that end within a tolerance, if late by some frames."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import behind, goal, in_phase, sight

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.base_model import Delay
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws import braking
from visual_servo_epipolar.core.laws.braking import braked_turn
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.odometry.legs import Slope
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settings import ServoSettings

FRAME_S, TOLERANCE = 0.09, 1.5e-3
FULL = ServoSettings()


@pytest.mark.parametrize('angle', [0.3, -0.5])
@pytest.mark.parametrize('late', [0.02, 0.11, 0.21])
def test_a_turn_is_a_trapezoid_however_late_the_base_obeys(angle: float, late: float) -> None:
    time, rates, left = landed(angle, late)
    assert time < abs(angle) / 0.5 + 0.5 / 1.2 + late + 2.5 * FRAME_S
    braking = np.diff(np.abs(rates)) / FRAME_S
    constant = braking[(braking < -1.0) & (np.abs(rates[1:]) > 0.15)]
    assert len(constant) >= (2 if late > 0.1 else 1)
    assert constant == pytest.approx(-1.2 * 1.2, rel=0.2)  # an exponential: from -1.9 to -0.5
    assert max(-each * math.copysign(1.0, angle) for each in left) < 5.0 * TOLERANCE


def landed(angle: float, late: float) -> tuple[float, FloatArray, list[float]]:
    """Return the time until TOLERANCE, the rates, what was left, of a base that obeys late [s]."""
    known, sent, heading, rates, left, last = Delay(), CommandsSent(), -angle, [], [], 0.0
    before = Twist(0.0, 0.0)
    for frame in range(60):
        now_ns = frame * round(FRAME_S * 1e9)
        seen = sight(
            stamp_ns=now_ns, heading_error=heading, offset=(0.0, -1.0), heading_deviation=1e-4
        )
        known = known.updated(seen, sent, FULL)
        state = in_phase(
            Phase.ORIENTING,
            period=FRAME_S,
            command=Command(before),
            measurement=seen,
            sent=sent,
            delay=known,
        )
        wanted = FULL.drive.within_speed(
            Twist(0.0, braked_turn(-heading, state.measurement, FULL))
        )
        before = FULL.drive.within_acceleration(wanted, before, FRAME_S)
        sent = sent.after(now_ns, before)
        next_ns = now_ns + round(FRAME_S * 1e9)
        heading += float(sent.turns(now_ns, next_ns, np.array([late]))[0])
        rates.append(before.angular)
        left.append(-heading)
        last = last if abs(heading) <= TOLERANCE else (frame + 1) * FRAME_S
    return last, np.array(rates), left


def test_by_pulses_a_turn_is_no_sharper_than_each_can_be_seen() -> None:
    state = in_phase(Phase.ORIENTING, period=FRAME_S)
    pulsed = replace(FULL, dead_band_angular=0.05)
    short, free = (braked_turn(0.01, state.measurement, settings) for settings in (pulsed, FULL))
    assert short == pytest.approx(0.01 * FULL.turn_gain, rel=0.01)
    assert free == pytest.approx(0.04 * FULL.turn_gain, rel=0.03)
    assert braked_turn(0.1, state.measurement, pulsed) == braked_turn(0.1, state.measurement, FULL)


def closing_in(x: float, *, heading: float = 0.0, y: float = -0.2) -> Twist:
    """Return the command of step 2 of who is at ``x``, ``y`` [m] by a memory of views."""
    seen = sight(offset=(x, y), heading_error=heading, difference=0.4 * y, view_margins=(1.0, 1.0))
    state = in_phase(Phase.MATCHING_FEATURES, slope=Slope(0.4, 1e6))
    return FULL.machine.row(state.phase).command(goal(seen, state), state, FULL)


def test_step_2_closes_in_slower_where_more_is_aside_or_unknown(monkeypatch) -> None:
    usual = closing_in(0.0).linear
    assert 0.02 < closing_in(0.02).linear < 0.7 * usual
    monkeypatch.setattr(braking, 'place_deviation', lambda _: 3e-4)
    assert closing_in(0.0).linear == usual
    monkeypatch.setattr(braking, 'place_deviation', lambda _: 1.5e-3)
    assert 0.0 < closing_in(0.0).linear < 0.3 * usual


def test_on_its_last_centimetre_step_2_faces_the_goal() -> None:
    near, aside = closing_in(0.0, heading=0.01, y=-0.003), closing_in(0.01, y=-0.003)
    assert near.angular == pytest.approx(-0.04 * FULL.turn_gain, rel=0.03)
    assert aside.angular == 0.0
    assert closing_in(0.01).angular > 0.0


@pytest.mark.parametrize('phase', [Phase.DISPLACING, Phase.ZEROING_EPIPOLES])
def test_turns_in_place_of_step_1_brake(phase: Phase) -> None:
    seen = sight(bearings=behind(0.0, 0.2), view_margins=(1.0, 1.0))
    state = in_phase(phase, latched=True, target=0.0)
    twist, unbraked = (
        settings.machine.row(phase).command(goal(seen, state), state, settings)
        for settings in (FULL, replace(FULL, speed_ramps=False))
    )
    assert twist.linear == 0.0
    assert twist.angular == pytest.approx(braked_turn(-0.2, state.measurement, FULL))
    assert -unbraked.angular < FULL.turn_gain * 0.2 < -twist.angular
