"""Moves by pulses: a robot with a dead band stands, measures, and moves once."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import in_phase, SETTINGS, sight

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.odometry.legs import Slope
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import first_pulse, pulsed_move, way_of_move
from visual_servo_epipolar.core.twoview.measurement import Measurement

THRESHOLD, FRAME_S, SLOPE = 0.024, 0.09, 0.1  # [rad/s] and [m/s], [s], [1/m]
HOP = THRESHOLD * FRAME_S
LOST = 0.5 * THRESHOLD**2 / (4.0 * SETTINGS.max_acceleration)  # of a way, by speeding up
BANDED = replace(SETTINGS, dead_band_angular=THRESHOLD, dead_band_linear=THRESHOLD)
TURN, DRIVE = Phase.ORIENTING, Phase.MATCHING_FEATURES
NO_ROOM = (0.0, 0.0)


def at(hops: float, **changes: object) -> Measurement:
    """Return what is seen ``hops`` past the goal, and turned by as many to the left."""
    seen = sight(
        heading_error=hops * HOP,
        heading_deviation=1e-6,
        offset=(0.0, hops * HOP),
        offset_deviation=1e-4,
        difference=hops * HOP * SLOPE,
        difference_slope=SLOPE,
        difference_deviation=1e-7,
        view_margins=(0.3, 0.3),
    )
    return replace(seen, **changes)


def slowly(seen: Measurement) -> Twist:
    """Return what a law wants near its aim."""
    return Twist(-1e-3 * seen.difference, -1e-3 * seen.heading_error)


def commanded(
    seen: Measurement, phase: Phase, frames: int = 12, settings: ServoSettings = BANDED, **changes
) -> list[float]:
    """Return the speeds that are sent while the robot is seen to stand where it is."""
    still = {'rest': seen, 'rested': settings.arrival_frames, 'period': FRAME_S}
    state = in_phase(phase, measurement=seen, **{**still, **changes})
    sent = []
    for _ in range(frames):
        move = pulsed_move(slowly(seen), state, settings)
        moved = state.settling.rested and move[0] == STANDSTILL
        state = state.changed(dead_band_residual=move[1], rested=state.settling.rested * moved)
        sent.append(move[0].angular if phase is TURN else move[0].linear)
    return sent


@given(hops=st.floats(1.05, 4.0), side=st.sampled_from([-1.0, 1.0]))
@pytest.mark.parametrize('phase', [TURN, DRIVE])
def test_one_train_of_pulses_leads_there(phase, hops, side) -> None:
    sent = commanded(at(side * hops), phase)
    pulses = [speed for speed in sent if speed]
    lost = 0.0 if phase is TURN else LOST
    assert sum(pulses) * FRAME_S == pytest.approx(-side * (hops * HOP + lost), abs=0.1 * HOP)
    assert sent[: len(pulses)] == pulses  # at once, one after the other
    assert all(abs(speed) >= THRESHOLD * (1.0 - 1e-6) for speed in pulses)


@pytest.mark.parametrize('phase', [TURN, DRIVE])
def test_no_move_begins_before_the_robot_has_stood_for_as_long_as_an_arrival_takes(phase) -> None:
    for short in (0, 1):
        sent = commanded(at(2.0), phase, rested=BANDED.arrival_frames - short)
        assert any(sent) is not bool(short)


def test_what_the_mean_may_be_wrong_by_is_no_reason_to_move() -> None:
    frames = BANDED.arrival_frames
    for error, moves in ((0.4, True), (0.6, False)):  # of half a hop, which is the bound
        square = (error * HOP * SLOPE * (frames - 1)) ** 2
        assert any(commanded(at(2.0), DRIVE, rest_square=square)) is moves


def test_a_turn_shorter_than_a_hop_leads_away_first_where_that_ends_nearer() -> None:
    room, bound = (1.0, 1.0), 0.15 * HOP
    for left in (0.4 * HOP, -0.4 * HOP):
        away = way_of_move(left, bound, HOP, room)
        assert away == pytest.approx(math.copysign(HOP, -left))
        assert way_of_move(left - away, bound, HOP, room) == left - away  # and back at once
        assert way_of_move(left, bound, HOP, NO_ROOM) == -away  # no way leads away to come back
        shut = (0.5 * HOP, 1.0) if left < 0.0 else (1.0, 0.5 * HOP)
        assert way_of_move(left, bound, HOP, shut) == 0.0  # features would leave the view
    assert way_of_move(0.6 * HOP, bound, HOP, room) == HOP  # one ends within half of it
    assert way_of_move(0.1 * HOP, bound, HOP, room) == 0.0


def test_pulses_of_irregular_images_are_no_reason_to_turn_away() -> None:
    """A pulse lasts as long as its image: two that miss by more than half a hop end no nearer."""
    assert any(commanded(at(0.45), TURN))
    assert not any(commanded(at(0.45), TURN, jitter=0.25 * FRAME_S))
    assert any(commanded(at(0.55), TURN, jitter=0.25 * FRAME_S))


def test_no_pulse_is_faster_than_the_robot_may_go() -> None:
    assert first_pulse(1.9 * THRESHOLD, THRESHOLD, 0.03) == 0.03
    assert first_pulse(-1.9 * THRESHOLD, THRESHOLD, 0.03) == -0.03
    slow = replace(BANDED, max_angular=0.03)
    assert commanded(at(1.3), TURN, 3, slow) == pytest.approx([-0.03, 0.0, 0.0])
    assert commanded(at(1.9), TURN, 3, slow) == pytest.approx([-THRESHOLD, -THRESHOLD, 0.0])


@pytest.mark.parametrize('limits', [{}, {'max_speed_ratio': 0.2}])
def test_a_long_turn_keeps_ramps_and_limits_until_it_ends(limits) -> None:
    gentle, last, sent = replace(BANDED, **limits), 0.0, []
    state = in_phase(TURN, measurement=at(150.0), rested=9, period=FRAME_S)
    while move := pulsed_move(slowly(at(150.0)), state, gentle):
        command = Command(move[0])
        state = state.changed(command=command, dead_band_residual=move[1], rested=0)
        sent.append(move[0].angular)
        if not sent[-1]:
            break
    assert sum(sent) * FRAME_S == pytest.approx(-150.0 * HOP)
    ramp = gentle.max_angular_acceleration * FRAME_S
    for speed in map(abs, sent):
        assert speed <= gentle.max_speed_ratio * gentle.max_angular
        assert last - speed <= 2.0 * ramp + THRESHOLD * (speed == 0.0)
        last = speed


def test_what_is_left_of_a_move_that_was_given_up_turns_no_other_one() -> None:
    wanted, rest = Twist(0.2, 0.1 * THRESHOLD), Twist(0.0, 9.0 * THRESHOLD)
    twist, rest = BANDED.drive.beyond_dead_band(wanted, rest, mode='pulse')
    assert (twist.angular, rest.angular) == (0.0, wanted.angular)


def test_a_robot_at_its_goal_that_stands_turns_by_one_train_however_far() -> None:
    seen, wanted = at(0.0, heading_error=0.2), Twist(0.0, -0.3)
    for rested in (BANDED.arrival_frames, 0):
        state = in_phase(DRIVE, measurement=seen, rest=seen if rested else None, rested=rested)
        twist, rest = pulsed_move(wanted, state, BANDED)
        assert bool(rest.angular) is bool(rested)
        assert twist.angular == -0.3 if not rested else abs(twist.angular) < 0.3


def test_no_pulse_rises_faster_than_the_ramp_allows_from_the_dead_band_on() -> None:
    gentle = replace(BANDED, max_angular_acceleration=0.05)
    most = THRESHOLD + 0.05 * FRAME_S
    assert max(commanded(at(-1.3), TURN)) > most
    assert max(commanded(at(-1.3), TURN, settings=gentle)) == pytest.approx(most)


def test_the_next_move_goes_by_where_the_last_one_ended() -> None:
    """Of a train of three pulses the base made one hop, or all of them, or more."""
    second = 1_000_000_000
    sent = CommandsSent()
    for frame in range(14):
        speed = THRESHOLD if frame in (1, 2, 3) else 0.0
        sent = sent.after(round(frame * FRAME_S * second), Twist(speed, 0.0))
    now_ns = round(14 * FRAME_S * second)

    def next_move(gone: float) -> float:
        known = {'stood': at(-4.0 - gone, stamp_ns=round(FRAME_S * second)), 'sent': sent}
        seen = at(-4.0, stamp_ns=now_ns)
        return sum(commanded(seen, DRIVE, settings=gentle, **known)) / THRESHOLD

    gentle = replace(BANDED, max_acceleration=0.02)
    # Before a move one that is faster than gentle ramps ends near.
    first = sum(commanded(at(-2.0), DRIVE, 9, gentle)) * FRAME_S
    assert 2.0 * HOP <= first <= 3.0 * HOP * (1.0 + 1e-9)
    slow, usual, quick = next_move(1.0), next_move(3.0), next_move(4.0)
    assert usual == quick == pytest.approx(4.0)
    assert 5.0 < slow < 8.0


def test_noise_of_one_image_does_not_end_a_move() -> None:
    seen, rest = at(-2.0), Twist(2.0 * THRESHOLD, 0.0)
    state = in_phase(DRIVE, measurement=seen, dead_band_residual=rest, period=FRAME_S)
    move = pulsed_move(Twist(2.0 * THRESHOLD, 0.0), state, BANDED)
    assert move[0] == Twist(THRESHOLD, 0.0)


def test_moves_are_for_the_end_of_what_a_memory_knows_and_no_base_follows() -> None:
    def does(phase=DRIVE, wanted=None, settings=BANDED, **changes) -> bool:
        seen = at(2.0, **changes)
        state = in_phase(phase, measurement=seen)
        return pulsed_move(wanted or slowly(seen), state, settings) is not None

    assert does() and does(TURN)
    assert not does(settings=SETTINGS)
    assert not does(TURN, settings=SETTINGS)
    assert not does(settings=replace(BANDED, dead_band_mode='raise'))
    assert not does(offset=None, difference_slope=math.nan) and not does(TURN, offset=None)
    assert not does(difference=-20.0 * HOP * SLOPE)
    assert not does(wanted=Twist(-0.2, -1e-4))
    assert not does(TURN, wanted=Twist(0.0, -0.3))
    assert not does(Phase.RETREATING)


def test_a_robot_turns_to_the_goals_heading_while_it_drives_there() -> None:
    for hops in (2.0, 0.0):  # ahead of it, and where it should be
        seen = at(hops, heading_error=-2.0 * HOP)
        state = in_phase(DRIVE, measurement=seen, rested=BANDED.arrival_frames, period=FRAME_S)
        move = pulsed_move(slowly(seen), state, BANDED)
        assert move[0].angular + move[1].angular == pytest.approx(2.0 * THRESHOLD)
        assert bool(move[0].linear) is bool(hops)


def test_two_views_tell_the_way_by_the_slope_of_d_and_where_it_should_stand_it_turns() -> None:
    seen = replace(at(2.0), offset=None, difference_slope=math.nan)
    pulses = commanded(seen, DRIVE, slope=Slope(SLOPE, 1.0))
    assert sum(pulses) * FRAME_S == pytest.approx(-2.0 * HOP - LOST)
    seen = replace(at(0.0), offset=None, difference_slope=math.nan)
    known = {'dead_band_residual': Twist(0.0, 0.6 * THRESHOLD), 'slope': Slope(SLOPE, 1.0)}
    state = in_phase(DRIVE, measurement=seen, rested=9, **known)
    assert pulsed_move(Twist(1e-4, 0.5 * THRESHOLD), state, BANDED)[0] == Twist(0.0, THRESHOLD)


def test_a_move_that_was_halted_does_not_go_on_after_it() -> None:
    """It was measured where the robot stood: somebody may have moved it since."""
    seen, rest = at(2.0), Twist(2.0 * THRESHOLD, 0.0)
    known = {'command': Command(Twist(THRESHOLD, 0.0)), 'dead_band_residual': rest}
    state = in_phase(DRIVE, measurement=seen, period=FRAME_S, **known)
    move = pulsed_move(slowly(seen), interrupted(state, Interruption.HALTED), BANDED)
    assert move == (STANDSTILL, STANDSTILL)
