"""Conditions at their boundaries: noise is no measurement, and what cannot be told is not so."""

from dataclasses import replace
from functools import partial
import math

import pytest
from servo_states import (
    asked,
    BEARINGS,
    behind,
    DRIVING,
    goal,
    in_phase,
    ranged,
    SETTINGS,
    sight,
    START,
)

from visual_servo_epipolar.core.estimate.goal_estimate import USUAL_STEP_S
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws.arrival import (
    align_bound,
    engage_bound,
    facing_bound,
    has_parallax,
    is_at_goal,
    matched_bound,
    release_bound,
)
from visual_servo_epipolar.core.laws.conditions import excursion_limit, is_sideways
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.odometry.legs import Leg, Slope
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import is_close, is_settled
from visual_servo_epipolar.core.servo.supervisor import (
    classify,
    switch_phase,
    update,
)
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

HALF_TURN = math.pi
SPENT_S = 1.0  # near the aim: what is finer than usual is not waited for any more


@pytest.mark.parametrize(
    ('bound', 'deviations', 'least'),
    [
        (engage_bound, 1.0, SETTINGS.latch_engage),
        (release_bound, 4.0, SETTINGS.latch_release),
        (partial(asked, align_bound, START), 1.0, SETTINGS.align_tolerance),
        (partial(asked, matched_bound, START), 2.0, 1.5e-3),
    ],
)
def test_what_is_within_its_noise_counts_as_zero(bound, deviations, least) -> None:
    settings = replace(SETTINGS, arrival_difference=1.5e-3)
    noisy = sight(deviation=0.1, difference_deviation=0.1)
    assert bound(noisy, settings) == pytest.approx(deviations * 0.1)
    for unknown in (0.0, math.nan):
        assert bound(sight(deviation=unknown, difference_deviation=0.0), settings) == least


def test_two_views_match_as_closely_as_the_base_moves_once_their_slope_is_known() -> None:
    """A base whose least hop leads from one side to the other would go back and forth."""
    seen, settings = sight(difference_deviation=0.0), replace(SETTINGS, dead_band_linear=0.08)
    for slope, bound in ((0.13, 0.5 * 0.08 * USUAL_STEP_S * 0.13), (math.nan, 0.0)):
        state = in_phase(Phase.MATCHING_FEATURES, slope=Slope(slope, 1.0))
        most = max(settings.arrival_difference, bound)
        assert asked(matched_bound, state, seen, settings) == most


def test_two_views_match_no_more_coarsely_than_asked_for_nor_by_a_slope_that_is_a_guess() -> None:
    settings = replace(SETTINGS, dead_band_linear=0.08, arrival_position=0.002)
    seen = sight(difference_deviation=1e-4)
    known, guess = (
        in_phase(Phase.MATCHING_FEATURES, slope=slope)
        for slope in (Slope(0.13, 1.0), Slope(2.0, 1e-8))
    )
    assert asked(matched_bound, known, seen, settings) <= 0.002 * 0.13
    assert asked(matched_bound, guess, seen, replace(settings, arrival_position=0.0)) == 2e-4


def test_a_memory_of_views_matches_as_closely_as_it_knows() -> None:
    """What is within a part of the noise is let pass, later what noise explains."""
    exact = sight(difference_slope=0.06, difference_deviation=0.0, offset=(0.0, 0.002))
    assert asked(matched_bound, START, exact, SETTINGS) == 0.0
    vague = replace(exact, difference_deviation=1e-4)
    assert asked(matched_bound, START, vague, SETTINGS) == pytest.approx(0.3e-4)
    at_last = START.changed(time_in_tolerance=SPENT_S)
    vaguer = replace(exact, difference_deviation=0.1)
    assert asked(matched_bound, at_last, vaguer, SETTINGS) == pytest.approx(0.2)


def test_a_memory_of_views_faces_the_goal_as_closely_as_it_knows() -> None:
    exact = sight(offset=(0.0, 0.0), heading_deviation=0.0)
    banded = replace(SETTINGS, dead_band_angular=0.1)
    for seen, bound in (
        (sight(), SETTINGS.arrival_heading),
        (exact, 0.0),
        (replace(exact, heading_deviation=5e-4), 1.5e-4),
        (replace(exact, heading_deviation=1.0), SETTINGS.arrival_heading),
    ):
        assert asked(facing_bound, START, seen, SETTINGS) == pytest.approx(bound)
    # What cannot be turned counts as zero.
    assert asked(facing_bound, START, exact, banded) > SETTINGS.arrival_heading


@pytest.mark.parametrize(('mode', 'frames'), [('pulse', 0.5), ('raise', 2.0)])
def test_no_base_is_asked_for_less_than_it_can_move(mode, frames) -> None:
    exact = sight(difference_slope=0.06, difference_deviation=0.0, offset=(0.0, 0.002))
    banded = replace(SETTINGS, dead_band_linear=0.05, dead_band_mode=mode)
    slow = in_phase(Phase.MATCHING_FEATURES, period=0.2)
    for state, period in ((START, 0.1), (slow, 0.2)):
        bound = pytest.approx(frames * period * 0.05 * 0.06)
        assert asked(matched_bound, state, exact, banded) == bound
    vague = replace(exact, difference_deviation=1e-3)  # a hop is no finer than a look
    assert asked(matched_bound, START, vague, banded) == pytest.approx(1e-3)
    free = replace(banded, dead_band_linear=0.0)
    late = slow.changed(time_in_tolerance=SPENT_S)
    for name in ('time_in_tolerance', 'time_at_goal'):
        waiting = (late.changed(**{name: seconds}) for seconds in (1, 3, 60))
        waits = [asked(matched_bound, state, vague, free) for state in waiting]
        assert waits == pytest.approx([2e-3, 3e-3, 4e-3])  # for long it is noise, up to that
    turning = replace(banded, dead_band_angular=0.05)
    sure = replace(exact, heading_deviation=0.0)
    # Pulses that are stretched to lead onto the heading end finer than equal ones.
    finer = 0.15 if mode == 'pulse' else frames
    weary = slow.changed(time_in_tolerance=60.0)
    for state, hops in ((slow, finer), (late, frames), (weary, 2.0 * frames)):
        assert asked(facing_bound, state, sure, turning) == pytest.approx(hops * 0.2 * 0.05)


NEAR = sight(
    offset=(0.0, 0.0),
    heading_deviation=0.0,
    difference_slope=0.06,
    difference_deviation=0.0,
    difference=0.9 * SETTINGS.arrival_difference,
    parallax=0.0,
)


def test_who_lingers_at_the_goal_is_asked_for_no_more_than_usual() -> None:
    """A base may be unable to come as near as a memory of views can tell."""
    exact = replace(NEAR, heading_error=0.9 * SETTINGS.arrival_heading)
    for phase in (Phase.MATCHING_FEATURES, Phase.ORIENTING):
        state = in_phase(phase, measurement=exact)
        assert not is_settled(state, SETTINGS)
        assert is_close(state, SETTINGS)
        assert is_settled(state.changed(time_in_tolerance=SPENT_S), SETTINGS)
    turned = in_phase(Phase.ORIENTING, time_in_tolerance=SPENT_S)
    assert asked(is_at_goal, turned, exact, SETTINGS)
    assert not asked(is_at_goal, in_phase(Phase.ORIENTING), exact, SETTINGS)
    assert not is_close(in_phase(Phase.RETREATING, measurement=exact), SETTINGS)


def test_who_is_near_lingers_and_a_new_phase_begins_anew() -> None:
    near = replace(NEAR, stamp_ns=10**9)
    state = in_phase(Phase.MATCHING_FEATURES, measurement=replace(near, stamp_ns=0))
    without = replace(SETTINGS, memory=False)
    state = update(state, Perception(near, fresh_memory(without)), 0.25, without)
    assert state.settling.time_in_tolerance == 0.25
    away = replace(near, stamp_ns=2 * 10**9, difference=0.1)
    state = update(state, Perception(away, fresh_memory(without)), 0.25, without)
    assert state.settling.time_in_tolerance == 0.25
    # What could not be had there is not tried for once more in the turn that ends it.
    for event, seconds in ((Event.MISSED, 0.0), (Event.TURNED, 0.25)):
        after = switch_phase(state, goal(away, state), event, without)
        assert after.settling.time_in_tolerance == seconds


@pytest.mark.parametrize(
    ('psi', 'phi', 'sideways'),
    [
        (-0.5 * math.pi, HALF_TURN, False),  # behind the goal, and facing it
        (-0.5 * math.pi, 0.0, True),  # behind it, and facing away
        (0.5 * math.pi, 0.0, True),  # past it
        (0.5 * math.pi, HALF_TURN, True),  # past it, and facing back
    ],
)
def test_only_from_behind_the_goal_with_it_ahead_step_1_begins(psi, phi, sideways) -> None:
    assert is_sideways(sight(bearings=Bearings(psi, phi)), SETTINGS) == sideways


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_step_1_is_given_up_later_than_it_is_not_begun(side: float) -> None:
    for alpha, begun, goes_on in ((0.05, False, False), (0.1, False, True), (0.2, True, True)):
        narrow = sight(bearings=behind(side * 0.3, -side * alpha), view_margins=(0.0, 0.0))
        other = sight(bearings=behind(side * 0.3, side * alpha), view_margins=(0.0, 0.0))
        found = [
            (not is_sideways(item, SETTINGS), not is_sideways(item, SETTINGS, factor=1.0))
            for item in (narrow, other)
        ]
        assert max(found) == (begun, goes_on)


@pytest.mark.parametrize(
    ('first', 'away', 'travel', 'led'),
    [
        # It refers to half a metre at least: 0.72 m are 1.44 of that, and the bound is 1.5.
        (0.4, 0.32, 0.0, False),
        (0.6, 0.36, 0.0, True),
        # What the leg leads backward is none, but a metre at most.
        (1.0, 0.7, 0.7, True),
        (1.0, 0.7, -0.15, True),
        (1.0, 0.7, -0.4, False),
        (1.0, 1.4, -1.4, False),
        (1.0, 1.6, -1.6, True),
    ],
)
def test_an_excursion_is_one_over_the_distance_at_which_the_leg_began(
    first, away, travel, led
) -> None:
    leg = Leg(away * math.cos(BEARINGS.psi), away * math.sin(BEARINGS.psi), travel)
    state = in_phase(Phase.MATCHING_FEATURES, leg=leg, extrinsics=ranged(first + away))
    assert bool(asked(excursion_limit, state, sight(), ServoSettings(max_excursion=1.5))) == led


@pytest.mark.parametrize('phase', DRIVING)
def test_as_many_features_as_are_needed_are_enough(phase: Phase) -> None:
    for features, lost in ((SETTINGS.min_features, False), (SETTINGS.min_features - 1, True)):
        state = in_phase(phase, measurement=sight(features=features))
        assert (classify(state, SETTINGS) is Event.LOST) == lost


def test_who_backs_off_without_bearings_near_the_goal_goes_on_backing_off() -> None:
    near = sight(bearings=None, parallax=0.0, difference=-1.0)
    state = in_phase(Phase.RETREATING, measurement=near)
    assert classify(state, SETTINGS) is Event.NOTHING


@pytest.mark.parametrize('short', [0, 1])
def test_a_turn_is_over_when_it_has_settled_for_as_long_as_told(short: int) -> None:
    state = in_phase(Phase.ORIENTING, settled=SETTINGS.align_frames - short)
    assert (classify(state, SETTINGS) is Event.NOTHING) == bool(short)


def test_no_baseline_is_no_reason_once_bearings_are_trusted() -> None:
    orienting = in_phase(Phase.ORIENTING, event=Event.NO_BASELINE, reason=Event.NO_BASELINE.value)
    blind = switch_phase(orienting, sight(bearings=None), Event.NOTHING, SETTINGS)
    assert blind.reason == 'no baseline'
    assert switch_phase(orienting, sight(), Event.NOTHING, SETTINGS).reason == ''


def test_step_1_ends_within_half_of_the_least_turn_and_what_that_misses_by() -> None:
    banded = replace(SETTINGS, dead_band_angular=0.2, dead_band_mode='pulse')
    state, least = in_phase(Phase.ZEROING_EPIPOLES), 0.2 * USUAL_STEP_S
    assert asked(align_bound, state, sight(), SETTINGS) < 0.5 * least
    assert asked(align_bound, state, sight(), banded) == pytest.approx((0.5 + 0.15) * least)


@pytest.mark.parametrize(
    ('features', 'deviations', 'changes', 'seen'),
    [
        # So many features that the root of their mean square varies by nothing.
        (10**8, 1.20, {}, False),
        (10**8, 1.30, {}, True),
        # Few vary more.
        (25, 0.97 * 1.3 * 1.25, {'memory': False}, False),
        (25, 1.03 * 1.3 * 1.25, {'memory': False}, True),
        (100, 0.97 * 1.15 * 1.25, {'memory': False}, False),
        (100, 1.03 * 1.15 * 1.25, {'memory': False}, True),
        # In doubt a robot allows for no such luck at first: a small way back and forth tells it.
        (25, 1.1 * 1.25, {}, True),
        (25, 1.1 * 1.25, {'attempts': 2}, False),
        (25, 1.1 * 1.25, {'focal_deviation': 1.0}, False),  # nothing is remembered through it
    ],
)
def test_noise_alone_shows_a_parallax_of_one_and_a_quarter(
    features, deviations, changes, seen
) -> None:
    still = sight(features=features, parallax=deviations * 0.3 / 769.0)
    state = in_phase(Phase.MATCHING_FEATURES, attempts=changes.get('attempts', 1))
    told = {name: value for name, value in changes.items() if name != 'attempts'}
    settings = replace(SETTINGS, arrival_parallax=0.0, **told)
    assert asked(has_parallax, state, still, settings) == seen
