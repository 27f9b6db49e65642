"""Trimming: the last pulses of a turn lead onto the heading, in spite of the dead band."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import in_phase, SETTINGS, sight

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.phases.bounds import PULSED_PATIENCE_S
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.pulse_turn import pulse_to, pulse_turn, turns_by_pulses
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

THRESHOLD, FRAME_S = 0.024, 0.09  # [rad/s], [s]
HOP = THRESHOLD * FRAME_S
BANDED = replace(SETTINGS, dead_band_angular=THRESHOLD)
SLOWLY = Twist(0.0, -1e-4)  # what a law wants near the heading


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


def test_no_pulse_is_faster_than_the_robot_may_turn() -> None:
    assert pulse_to(1.9 * HOP, THRESHOLD, FRAME_S, most=0.03) == 0.03
    assert pulse_to(-1.9 * HOP, THRESHOLD, FRAME_S, most=0.03) == -0.03


def test_pulses_obey_the_limit_of_the_settings() -> None:
    slow = replace(BANDED, max_angular=1.2 * THRESHOLD)
    assert min(commanded(turned(1.9), 12, slow)) == -1.2 * THRESHOLD


def turned(hops: float, **changes: object) -> Measurement:
    return sight(
        heading_error=hops * HOP,
        heading_deviation=1e-6,
        offset=(0.0, 0.0),
        offset_deviation=1e-4,
        view_margins=(0.3, 0.3),
        **changes,
    )


def commanded(
    measurement: Measurement, frames: int, settings: ServoSettings = BANDED, **changes: object
) -> list[float]:
    """Return the rates that are sent [rad/s] while the robot is seen to stand."""
    state = in_phase(Phase.ORIENTING, measurement=measurement, period=FRAME_S, **changes)
    sent = []
    for _ in range(frames):
        twist, residual = pulse_turn(SLOWLY, state, settings)
        state = state.changed(dead_band_residual=residual)
        sent.append(twist.angular)
    return sent


@pytest.mark.parametrize('hops', [0.5, 1.5, -0.5, -1.5])
def test_one_pulse_is_seen_before_the_next(hops) -> None:
    sent = commanded(turned(hops), 12)
    pulses = [k for k, rate in enumerate(sent) if rate]
    assert len(pulses) == 1
    assert pulses[0] * FRAME_S > 0.5
    away = abs(hops) < 1.0
    assert sent[pulses[0]] * hops > 0.0 if away else sent[pulses[0]] * hops < 0.0


def test_who_is_on_the_heading_is_sent_nothing() -> None:
    assert not any(commanded(turned(0.1), 30))


def test_a_late_base_is_not_sent_away_from_where_a_pulse_on_its_way_leads() -> None:
    late = replace(BANDED, latency=0.8)
    stamp = turned(1.5).stamp_ns
    pulse = Twist(0.0, -1.5 * HOP / FRAME_S)
    sent = CommandsSent(
        (stamp - round(2 * FRAME_S * 1e9), stamp - round(FRAME_S * 1e9)), (pulse, STANDSTILL)
    )
    assert not any(commanded(turned(1.5), 30, late, sent=sent))


def test_nobody_turns_features_out_of_view_to_come_back() -> None:
    assert any(commanded(turned(0.5), 12))
    assert not any(commanded(replace(turned(0.5), view_margins=(0.5 * HOP, 0.3)), 12))


@pytest.mark.parametrize('hops', [1.5, -1.5])
def test_what_waits_for_a_pulse_leads_no_other_way(hops) -> None:
    state = in_phase(Phase.ORIENTING, measurement=turned(hops), period=FRAME_S)
    _, residual = pulse_turn(SLOWLY, state, BANDED)
    assert residual.angular * hops < 0.0


def test_speed_is_not_cut_and_large_turns_are_left_alone() -> None:
    state = in_phase(Phase.ORIENTING, measurement=turned(1.5), period=FRAME_S)
    for wanted in (Twist(0.2, -1e-4), Twist(0.0, -0.3)):
        assert pulse_turn(wanted, state, BANDED) == (wanted, STANDSTILL)


def test_trimming_is_for_turns_in_place_to_what_is_known_and_for_some_seconds() -> None:
    def does(settings: ServoSettings = BANDED, **changes: object) -> bool:
        state: ServoState = in_phase(Phase.ORIENTING, measurement=turned(1.5), **changes)
        return turns_by_pulses(state, settings)

    assert does()
    assert not does(SETTINGS)
    assert not does(replace(BANDED, dead_band_mode='raise'))
    assert not does(time_in_tolerance=PULSED_PATIENCE_S + 0.1)
    assert not turns_by_pulses(in_phase(Phase.MATCHING_FEATURES, measurement=turned(1.5)), BANDED)
    assert not turns_by_pulses(
        in_phase(Phase.ORIENTING, measurement=replace(turned(1.5), offset=None)), BANDED
    )
