"""Settling: a robot that stands is judged by the mean of what it measures there."""

from dataclasses import replace

import pytest
from servo_states import in_phase, seeing, SETTINGS, sight

from visual_servo_epipolar.core.estimate.dead_band import DeadBand, Threshold
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.smooth import APPROACHING
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import is_settled, seen_after, settle
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import advance, classify, nominal_twist
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

FRAME_NS = 100_000_000
BANDED = replace(SETTINGS, dead_band_linear=0.03)
BOUND = 0.5 * 0.03 * 0.1 * 0.1  # half a hop, as D
SEEN = (
    round(seen_after(ServoSettings()) * 1e9) // FRAME_NS
)  # frames until the last motion was seen


def stood(
    differences: list[float],
    last: Twist = STANDSTILL,
    phase: Phase = Phase.MATCHING_FEATURES,
    *,
    remembered: bool = True,
) -> ServoState:
    """Return the state after these D were seen by a robot that stands; ``last`` is commanded."""
    state, sent = in_phase(phase), CommandsSent().after(0, Twist(0.03, 0.0))
    for frame, difference in enumerate([0.1] * SEEN + differences, start=1):
        known = {'offset': (0.0, 10.0 * difference), 'difference_slope': 0.1}
        known |= {'heading_error': 0.0, 'heading_deviation': 1e-4}
        seen = sight(frame, difference=difference, difference_deviation=1e-6)
        seen = replace(seen, **known) if remembered else seen
        sent = sent.after(frame * FRAME_NS - 1, STANDSTILL) if last == STANDSTILL else sent
        before = state.measurement
        state = settle(seeing(state, measurement=seen, sent=sent), None, before, 0.1, BANDED)
        sent = sent.after(frame * FRAME_NS, last)
    return state


def test_a_mean_of_what_is_seen_at_rest_decides_not_each_image() -> None:
    swings = [1.5 * BOUND, -1.5 * BOUND] * 4
    state = stood(swings)
    assert state.settling.rest.difference == pytest.approx(0.0, abs=1e-12)
    assert state.settling.rest.offset == pytest.approx((0.0, 0.0))
    assert state.settling.rested == 8
    assert state.settling.rest_square == pytest.approx(8.0 * (1.5 * BOUND) ** 2)
    assert is_settled(state, BANDED)
    assert not is_settled(seeing(state, rest=None), BANDED)
    assert stood([*swings, 3.0 * BOUND]).settling.settled > 1  # no outlier begins anew
    assert not is_settled(stood([1.5 * BOUND] * 8), BANDED)


def test_two_views_alone_are_averaged_at_rest_as_well() -> None:
    state = stood([3e-3, -3e-3] * 4, remembered=False)
    assert state.settling.rest.difference == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ('gone', 'amid', 'first_pulse', 'raised'),
    [
        (0.0, None, 0.03, True),
        (0.5, None, 0.03, False),
        (0.0, Phase.HOLDING, 0.03, False),
        (0.0, Interruption.HALTED, 0.03, False),
        (0.0, None, -0.05, False),
    ],
)
def test_a_train_of_pulses_after_which_the_robot_stands_as_before_shows_a_dead_band(
    gone, amid, first_pulse, raised
) -> None:
    """
    Metres tell, by means of what is seen before and after; BANDED has what was learnt.

    Not so after an interruption, in which it was moved, or commands back and forth.
    """
    state = seeing(stood([1e-3] * 8), dead_band=DeadBand(linear=Threshold(0.03)))
    sent, pulse = state.motion.sent, Twist(0.03, 0.0)
    first = 1 + SEEN + 8
    for frame in range(first, first + 3 + SEEN + BANDED.arrival_frames):
        difference = 1e-3 + gone * 3 * 0.03 * 0.1 * 0.1 * (frame > first + 3)
        seen = replace(state.settling.stood or state.measurement, stamp_ns=frame * FRAME_NS)
        seen = replace(seen, difference=difference)
        holds = frame == first + 3 and isinstance(amid, Phase)
        phase = amid if holds else Phase.MATCHING_FEATURES
        state = seeing(state, measurement=seen, sent=sent, phase=phase)
        state = settle(state, None, None, 0.1, BANDED)
        if frame == first + 2 and isinstance(amid, Interruption):
            state = interrupted(state.changed(command=Command(pulse)), amid)
        speed = first_pulse if frame == first else pulse.linear if frame < first + 3 else 0.0
        sent = sent.after(frame * FRAME_NS, Twist(speed, 0.0))
    assert state.settling.rested == BANDED.arrival_frames
    assert (state.identified.dead_band.linear.value > 0.03) is raised


@pytest.mark.parametrize(('turned', 'raised'), [(0.0, True), (0.5, False)])
def test_a_turn_after_which_the_heading_is_as_before_shows_a_dead_band(turned, raised) -> None:
    state = seeing(stood([1e-3] * 8), dead_band=DeadBand(angular=Threshold(0.03)))
    sent, first = state.motion.sent, 1 + SEEN + 8
    for frame in range(first, first + 3 + SEEN + BANDED.arrival_frames):
        seen = replace(state.settling.stood or state.measurement, stamp_ns=frame * FRAME_NS)
        seen = replace(seen, heading_error=turned * 3 * 0.03 * 0.1 * (frame > first + 3))
        state = settle(seeing(state, measurement=seen, sent=sent), None, None, 0.1, BANDED)
        sent = sent.after(frame * FRAME_NS, Twist(0.0, 0.03 * (frame < first + 3)))
    assert (state.identified.dead_band.angular.value > 0.03) is raised


def test_time_at_the_goal_is_that_within_20_mm() -> None:
    for seen, seconds in (
        ([1.9e-3] * 8, 0.8),
        ([2.1e-3] * 8, 0.0),
        ([1.9e-3] * 8 + [2.1e-3], 0.0),
    ):
        assert stood(seen).settling.time_at_goal == pytest.approx(seconds)


@pytest.mark.parametrize('last', [Twist(0.0, 0.1), Twist(0.03, 0.0)])
def test_a_robot_that_moves_or_whose_motion_is_not_seen_yet_does_not_rest(last) -> None:
    assert stood([0.0] * 8, last).settling.rest is None
    assert stood([]).settling.rested == 0 < stood([0.0]).settling.rested
    assert stood([0.0] * 8, phase=Phase.HOLDING).settling.rest is None


def test_a_robot_whose_commands_do_not_move_its_base_rests() -> None:
    slowly = Twist(0.029, 0.0)
    assert stood([0.0] * 8, slowly).settling.rested == 7
    assert not stood([2.9e-4 * frame for frame in range(8)], slowly).settling.rested  # they do


def at_goal(turned: float = 0.0) -> Measurement:
    """Return what a memory of views knows at the goal, ``turned`` to the left [rad]."""
    where = {'offset': (0.0, 0.0), 'heading_error': turned, 'difference': 0.0, 'parallax': 0.0}
    known = {'offset_deviation': 1e-4, 'heading_deviation': 1e-4, 'difference_deviation': 1e-6}
    return sight(**where, **known, difference_slope=0.1)


def test_a_mean_at_the_goal_is_no_miss_for_the_swing_of_one_image() -> None:
    here = at_goal()
    swung = replace(here, offset=(0.0, 0.02), difference=2e-3)
    frames = {'settled': BANDED.arrival_frames, 'settled_parallax': 0.0}
    state = in_phase(Phase.MATCHING_FEATURES, measurement=swung, rest=here, **frames)
    assert classify(state, BANDED) is Event.MATCHED
    assert classify(seeing(state, rest=None), BANDED) is not Event.MATCHED


@pytest.mark.parametrize(('turned', 'event'), [(0.05, Event.TURNED), (1e-3, Event.MATCHED)])
def test_one_motion_ends_with_a_turn_in_place_where_it_does_not_face(turned, event) -> None:
    smooth = ServoSettings(law='smooth', dead_band_linear=0.03, dead_band_angular=0.05)
    here = at_goal(turned)
    frames = {'settled': smooth.arrival_frames, 'settled_parallax': 0.0}
    state = in_phase(APPROACHING.phase, measurement=here, rest=here, **frames)
    assert is_settled(state, smooth)
    assert classify(state, smooth) is event
    if event is Event.TURNED:
        assert not is_settled(seeing(state, rest=None), smooth)  # it may still turn on its way


def test_a_robot_that_stands_within_its_bound_stands_until_that_ends() -> None:
    """It is to turn by far, but in place: the law that turns it meanwhile would begin all anew."""
    smooth = replace(BANDED, law='smooth')
    state = stood([0.0] * 2, phase=APPROACHING.phase)
    aside = replace(state.measurement, stamp_ns=state.measurement.stamp_ns + FRAME_NS)
    aside = replace(aside, heading_error=-0.2)
    state = advance(state, Perception(aside, fresh_memory(smooth)), smooth)
    assert state.settling.settled > 0
    assert nominal_twist(state, smooth).angular > BANDED.max_angular / 10.0
    assert state.twist == STANDSTILL
