"""Trimming: the last pulses of a turn lead onto the heading, in spite of the dead band."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.servo.trimming import pulse_to

THRESHOLD, FRAME_S = 0.024, 0.09  # [rad/s], [s]
HOP = THRESHOLD * FRAME_S


@given(turn=st.floats(HOP, 20.0 * HOP), side=st.sampled_from([-1.0, 1.0]))
def test_a_whole_number_of_pulses_leads_onto_the_heading(turn, side) -> None:
    pulse = pulse_to(side * turn, THRESHOLD, FRAME_S)
    assert THRESHOLD <= abs(pulse) * (1.0 + 1e-12) < 2.0 * THRESHOLD * (1.0 + 1e-9)
    hops = side * turn / (pulse * FRAME_S)
    assert hops == pytest.approx(round(hops))
    assert hops > 0.5


@given(turn=st.floats(0.01 * HOP, 0.99 * HOP), side=st.sampled_from([-1.0, 1.0]))
def test_who_is_nearer_than_a_hop_turns_away_first_and_is_there_with_the_second(
    turn, side
) -> None:
    away = pulse_to(side * turn, THRESHOLD, FRAME_S)
    assert away == math.copysign(THRESHOLD, -side)
    left = side * turn - away * FRAME_S
    assert pulse_to(left, THRESHOLD, FRAME_S) * FRAME_S == pytest.approx(left)
