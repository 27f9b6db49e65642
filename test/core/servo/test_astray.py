"""No phase leads farther than it may."""

from dataclasses import replace
import math
from typing import Any

import pytest
from servo_states import (
    BEARINGS,
    in_phase,
    ranged,
    SETTINGS,
    sight,
    STEPS,
    then,
)

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.servo.phases.conditions import astray
from visual_servo_epipolar.core.servo.phases.events import classify
from visual_servo_epipolar.core.servo.phases.table import DRIVING, Event, Phase
from visual_servo_epipolar.core.servo.ranging import Leg
from visual_servo_epipolar.core.servo.state import ServoState

# Backing off


def test_who_backs_off_too_far_fails_and_says_so() -> None:
    state = then(in_phase(Phase.RETREATING, travel=-10.01))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == 'backed off by 10.0 m (max_retreat), the goal is still not ahead'


@pytest.mark.parametrize('travel', [-9.99, 10.01])
def test_backing_off_may_take_that_long(travel: float) -> None:
    assert then(in_phase(Phase.RETREATING, travel=travel)).phase is not Phase.FAILED


def test_the_bound_of_backing_off_is_a_setting_and_counts_what_was_driven() -> None:
    settings = replace(SETTINGS, max_retreat=0.5)
    sideways = sight(bearings=Bearings(-0.3, -0.3 - math.pi / 2.0), difference=0.1)
    state = in_phase(Phase.RETREATING, measurement=replace(sideways, stamp_ns=0))
    for frame in range(1, 60):
        state = then(state, replace(sideways, stamp_ns=frame * 100_000_000), settings)
        if state.phase is Phase.FAILED:
            break
    assert state.reason.startswith('backed off by 0.5 m (max_retreat)')
    # 0.2 m/s from a standstill: not before 2.5 s.
    assert 26 <= state.frame <= 35


# The longest way


@pytest.mark.parametrize('phase', STEPS)
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_no_way_is_longer_than_the_distance_allows(phase: Phase, sign: float) -> None:
    settings = replace(SETTINGS, initial_distance=4.0)
    state = then(in_phase(phase, travel=sign * 6.01), settings=settings)
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == f'drove 6 m in {phase.value} and is not there (initial_distance)'
    assert then(in_phase(phase, travel=sign * 5.99), settings=settings).phase is not Phase.FAILED


@pytest.mark.parametrize('phase', [Phase.ORIENTING, Phase.DISPLACING, Phase.RETREATING])
def test_other_phases_have_no_longest_way(phase: Phase) -> None:
    assert astray(in_phase(phase, travel=1e3), sight(), SETTINGS) == ''


# The excursion


def off(ratio: float, phase: Phase = Phase.ZEROING_EPIPOLES, **changes: Any) -> ServoState:
    """Return a state that is ``ratio`` times as far off as where its leg began."""
    distance = 3.0
    x, y = (distance * (1.0 - 1.0 / ratio) * f(BEARINGS.psi) for f in (math.cos, math.sin))
    leg = Leg(BEARINGS.psi, x, y)
    return in_phase(phase, **{'leg': leg, 'extrinsics': ranged(distance), **changes})


@pytest.mark.parametrize('phase', STEPS)
def test_who_is_led_away_from_the_goal_fails_and_says_so(phase: Phase) -> None:
    state = then(off(1.4, phase))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == (
        f'{phase.value} leads away from the goal: 1.4 times the distance (max_excursion)'
    )
    assert then(off(1.29, phase)).phase is not Phase.FAILED


def test_the_bound_of_the_excursion_is_a_setting() -> None:
    assert then(off(1.29), settings=replace(SETTINGS, max_excursion=1.28)).phase is Phase.FAILED
    assert then(off(2.0), settings=replace(SETTINGS, max_excursion=2.1)).phase is not Phase.FAILED


@pytest.mark.parametrize(
    'changes',
    [
        {'leg': None},
        {'extrinsics': None},
        {'extrinsics': ranged(deviation=0.26)},
        {'phase': Phase.RETREATING},
        {'phase': Phase.DISPLACING},
    ],
    ids=['no leg', 'no belief', 'not ranged', 'backing off', 'displacing'],
)
def test_a_distance_that_is_not_known_leads_nobody_astray(changes: dict[str, Any]) -> None:
    assert astray(off(2.0), sight(), SETTINGS) != ''
    assert astray(replace(off(2.0), **changes), sight(), SETTINGS) == ''


def test_without_bearings_nobody_is_astray() -> None:
    assert astray(off(2.0), sight(bearings=None), SETTINGS) == ''


def test_a_law_that_leads_away_by_itself_may_do_so() -> None:
    # Without retreat a law begins with concordant epipoles as well, and backs away.
    assert astray(off(2.0), sight(), replace(SETTINGS, law='full-retreat')) == ''


def test_near_the_goal_the_excursion_refers_to_half_a_metre() -> None:
    near = ranged(0.3)
    at_first = Leg(BEARINGS.psi, 0.29 * math.cos(BEARINGS.psi), 0.29 * math.sin(BEARINGS.psi))
    assert astray(off(2.0, leg=at_first, extrinsics=near), sight(), SETTINGS) == ''


@pytest.mark.parametrize('phase', DRIVING)
def test_every_driving_phase_ends_where_it_is_astray(phase: Phase) -> None:
    state = off(2.0, phase, travel=-1e3)
    state = replace(state, measurement=sight())
    bounded = phase is Phase.RETREATING or phase in STEPS
    assert (classify(state, SETTINGS) is Event.ASTRAY) == bounded
