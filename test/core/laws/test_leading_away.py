"""A spiral that was begun on the wrong side is begun anew, before it leads away."""

from dataclasses import replace
import math

import pytest
from servo_states import behind, in_phase, seeing, SETTINGS, sight

from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.two_steps import leads_away
from visual_servo_epipolar.core.servo.supervisor import classify

STATE = in_phase(Phase.ZEROING_EPIPOLES, target=math.tan(-0.14), side=1.0)


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
    event = classify(seeing(STATE, measurement=there), SETTINGS)
    assert (event is Event.ESCAPED) is away


def test_what_is_lost_in_the_noise_is_on_no_side() -> None:
    assert not leads_away(sight(bearings=behind(-0.06, 0.03), deviation=0.03), SETTINGS)
    assert not leads_away(sight(bearings=None), SETTINGS)


def test_a_law_that_may_lead_away_at_first_does_and_once_e_du_is_zero_a_turn_is_left() -> None:
    there = sight(bearings=behind(-0.06, 0.03))
    for law in ({'law': 'paper'}, {'law': 'corrected'}, {'retreat': False}):
        assert not leads_away(there, replace(SETTINGS, **law))
    latched = seeing(STATE, measurement=there, latched=True)
    assert classify(latched, replace(SETTINGS, latch_release=0.5)) is not Event.ESCAPED
