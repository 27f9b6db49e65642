"""Step 1 begins anew where e_du has left zero for good, and not for what step 2 takes up."""

from dataclasses import replace
import math

import pytest
from servo_states import asked, behind, goal, in_phase, seeing, SETTINGS, sight

from visual_servo_epipolar.core.laws.arrival import hysteresis
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.two_steps import escape_bound, leads_away, MOST_RESTARTS
from visual_servo_epipolar.core.servo.supervisor import classify, switch_phase

STATE = in_phase(Phase.ZEROING_EPIPOLES, latched=True)
REMEMBERED = sight(offset=(0.0, -1.4), offset_deviation=1e-3)


@pytest.mark.parametrize('chi', [0.06, -0.06])
def test_what_step_2_takes_up_does_not_begin_step_1_anew(chi: float) -> None:
    there = replace(REMEMBERED, bearings=behind(chi, 0.1))
    assert classify(seeing(STATE, measurement=there), SETTINGS) is Event.NOTHING
    away = replace(REMEMBERED, bearings=behind(2.0 * chi, 0.1))
    assert classify(seeing(STATE, measurement=away), SETTINGS) is Event.ESCAPED


@pytest.mark.parametrize(
    'law', [{'law': 'paper'}, {'law': 'corrected'}, {'line_following': False}]
)
def test_laws_that_follow_no_line_have_to_zero_it(law) -> None:
    settings = replace(SETTINGS, **law)
    assert asked(escape_bound, STATE, REMEMBERED, settings) == settings.latch_release
    there = replace(REMEMBERED, bearings=behind(0.06, 0.1))
    assert classify(seeing(STATE, measurement=there), settings) is Event.ESCAPED


def test_near_the_goal_less_is_taken_up() -> None:
    bounds = [
        asked(escape_bound, STATE, replace(REMEMBERED, offset=(0.0, -y)), SETTINGS)
        for y in (0.2, 0.3, 0.4, 1.4)
    ]
    assert bounds == sorted(bounds)
    assert bounds[0] < 0.03 < bounds[-1] <= 0.1


@pytest.mark.parametrize('event', [Event.ESCAPED, Event.SIDEWAYS])
def test_each_time_step_1_is_given_up_it_is_held_on_to_more(event) -> None:
    """One hysteresis for both steps: else noise leads to and fro, or a geometry told wrong."""
    state = switch_phase(STATE, goal(REMEMBERED, STATE), event, SETTINGS)
    assert (state.run.restarts, hysteresis(state, SETTINGS)) == (1, 2.0)
    assert hysteresis(state, replace(SETTINGS, law='corrected')) == 1.0  # it never backs off
    again = STATE.changed(restarts=1)
    near = replace(REMEMBERED, offset=(0.0, -0.1), deviation=0.01)
    bounds = [asked(escape_bound, state, near, SETTINGS) for state in (STATE, again)]
    assert bounds[1] == 2.0 * bounds[0]
    held = again.changed(latched=False, target=0.2)
    away = replace(REMEMBERED, bearings=behind(0.01, -0.2))
    assert classify(seeing(held, restarts=0, measurement=away), SETTINGS) is Event.ESCAPED
    assert classify(seeing(held, measurement=away), SETTINGS) is Event.NOTHING


def test_step_1_that_is_given_up_too_often_ends_the_run() -> None:
    state = STATE.changed(phase=Phase.DISPLACING, restarts=MOST_RESTARTS - 1)
    held = switch_phase(state, goal(REMEMBERED, state), Event.LOST, SETTINGS)
    assert (held.phase, held.run.restarts) == (Phase.HOLDING, MOST_RESTARTS)
    again = switch_phase(held, goal(REMEMBERED, held), Event.APART, SETTINGS)
    assert again.phase is Phase.FAILED and 'given up 12 times' in again.reason
    once = held.changed(restarts=1)
    once = switch_phase(once, goal(REMEMBERED, once), Event.APART, SETTINGS)
    assert once.phase is Phase.DISPLACING


def test_who_has_no_room_for_the_spiral_backs_off_before_step_1_begins_anew() -> None:
    away = replace(REMEMBERED, bearings=behind(0.3, 0.0), view_margins=(0.01, 0.01))
    assert classify(seeing(STATE, measurement=away), SETTINGS) is Event.SIDEWAYS
    room = replace(away, view_margins=(0.5, 0.5))
    assert classify(seeing(STATE, measurement=room), SETTINGS) is Event.ESCAPED


# A spiral that was begun on the wrong side is begun anew, before it leads away.
BEGUN = in_phase(Phase.ZEROING_EPIPOLES, target=math.tan(-0.14), side=1.0)


@pytest.mark.parametrize(
    ('chi', 'alpha', 'away'),
    [
        (0.06, 0.03, True),
        (-0.06, -0.14, True),
        (0.06, -0.14, False),
        (0.005, 0.03, False),
        (0.06, -0.01, False),
    ],
)
def test_it_is_on_the_wrong_side_if_both_epipoles_are_on_one(chi, alpha, away) -> None:
    there = sight(bearings=behind(-chi, alpha))
    assert leads_away(there, SETTINGS) is away
    event = classify(seeing(BEGUN, measurement=there), SETTINGS)
    assert (event is Event.ESCAPED) is away


def test_what_is_lost_in_the_noise_is_on_no_side() -> None:
    assert not leads_away(sight(bearings=behind(-0.06, 0.03), deviation=0.03), SETTINGS)
    assert not leads_away(sight(bearings=None), SETTINGS)


def test_a_law_that_may_lead_away_at_first_does_and_once_e_du_is_zero_a_turn_is_left() -> None:
    there = sight(bearings=behind(-0.06, 0.03))
    for law in ({'law': 'paper'}, {'law': 'corrected'}, {'retreat': False}):
        assert not leads_away(there, replace(SETTINGS, **law))
    latched = seeing(BEGUN, measurement=there, latched=True)
    assert classify(latched, replace(SETTINGS, latch_release=0.5)) is not Event.ESCAPED
