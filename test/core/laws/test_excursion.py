"""No phase leads farther than it may."""

from dataclasses import replace
import math
from typing import Any

import pytest
from servo_states import (
    asked,
    BEARINGS,
    DRIVING,
    estimated,
    in_phase,
    ranged,
    seeing,
    SETTINGS,
    sight,
    STEPS,
    then,
)

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.conditions import excursion_limit
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.odometry.legs import Leg
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify

# Driving backward


@pytest.mark.parametrize('phase', [*DRIVING, Phase.HOLDING])  # also while tracks are lost
def test_who_drives_backward_too_far_fails_and_says_so(phase: Phase) -> None:
    state = then(in_phase(phase, reversed=20.01))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == f'drove 20.0 m backward in this run (max_retreat), still {phase.value}'
    assert then(in_phase(phase, reversed=19.99)).phase is not Phase.FAILED


@pytest.mark.parametrize(
    ('changes', 'most'),
    [
        ({'law': 'paper'}, 30.0),  # laws that lead away by themselves: half as far again
        ({'law': 'corrected'}, 30.0),
        ({'retreat': False}, 30.0),
        ({'max_retreat': 0.0}, 0.1),  # small corrections are no backing off
    ],
)
def test_how_far_backward_a_law_may_drive(changes, most) -> None:
    settings = replace(SETTINGS, **changes)
    for phase, driven, ends in ((STEPS[0], 0.99, False), (STEPS[1], 1.01, True)):
        limit = asked(excursion_limit, in_phase(phase, reversed=driven * most), sight(), settings)
        assert ('backward in this run (max_retreat)' in limit) is ends


SIDEWAYS = sight(bearings=Bearings(-0.3, -0.3 - math.pi / 2.0), difference=0.1)


def backing_off(settings: ServoSettings, *, frames: int = 60, **changes: Any) -> ServoState:
    """Return the state after ``frames`` beside the goal, or when it has failed."""
    state = in_phase(Phase.RETREATING, measurement=replace(SIDEWAYS, stamp_ns=0), **changes)
    for frame in range(1, frames):
        state = then(state, replace(SIDEWAYS, stamp_ns=frame * 100_000_000), settings)
        if state.phase is Phase.FAILED:
            break
    return state


def test_what_former_attempts_drove_backward_counts_as_well() -> None:
    settings = replace(SETTINGS, max_retreat=0.5)
    assert backing_off(settings, reversed=0.4).view.frame < 20
    missed = in_phase(Phase.MATCHING_FEATURES, reversed=0.4, travel=-0.4)
    there = sight(difference=0.0, heading_error=0.0)
    state = then(missed.changed(settled=3 * SETTINGS.arrival_frames, settled_parallax=1.0), there)
    assert (state.phase, state.run.attempts) == (Phase.RETREATING, 2)
    assert (state.run.travel, state.motion.reversed) == (0.0, 0.4)


@pytest.mark.parametrize('kinds', [('LOST',), ('HALTED', 'LOST'), ('LOST', 'HALTED', 'TIMED_OUT')])
def test_a_command_that_was_withdrawn_meanwhile_counts_in_full(kinds: tuple[str, ...]) -> None:
    # The base obeyed it until then, and nobody says how long.
    state = in_phase(Phase.RETREATING, command=Command(Twist(-0.2, 0.0)))
    for kind in kinds:
        state = interrupted(state, Interruption[kind], 'no new tracks')
    assert then(state, sight(5)).motion.reversed == pytest.approx(0.1)


@pytest.mark.parametrize(('frame', 'seconds'), [(1300, 0.1), (0, 0.1), (-9000, 0.1)])
def test_stamps_that_leap_do_not_hide_what_is_driven_backward(frame: int, seconds: float) -> None:
    state = in_phase(Phase.RETREATING, command=Command(Twist(-0.2, 0.0)), period=0.1)
    assert then(state, sight(frame)).motion.reversed == pytest.approx(0.2 * seconds)


# The longest way


@pytest.mark.parametrize('phase', STEPS)
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_no_way_is_longer_than_the_distance_allows(phase: Phase, sign: float) -> None:
    settings = replace(SETTINGS, initial_distance=4.0)
    state = then(in_phase(phase, travel=sign * 6.01), settings=settings)
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == f'drove 6 m in {phase.value} and is not there (initial_distance)'
    assert then(in_phase(phase, travel=sign * 5.99), settings=settings).phase is not Phase.FAILED


@pytest.mark.parametrize(
    ('left', 'travel', 'ends'), [(2.0, 6.01, False), (3.1, 6.01, True), (2.0, 12.01, True)]
)
def test_by_its_memory_it_may_have_begun_twice_as_far_away(left, travel, ends) -> None:
    settings = replace(SETTINGS, initial_distance=4.0)
    seen = replace(sight(), offset=(0.1, math.sqrt(left**2 - 0.01)))
    limit = asked(excursion_limit, in_phase(Phase.ZEROING_EPIPOLES, travel=travel), seen, settings)
    assert ('initial_distance' in limit) is ends


# The excursion


def off(ratio: float, phase: Phase = Phase.ZEROING_EPIPOLES, **changes: Any) -> ServoState:
    """Return a state that is ``ratio`` times as far off as where its leg began."""
    distance = 3.0
    x, y = (distance * (1.0 - 1.0 / ratio) * f(BEARINGS.psi) for f in (math.cos, math.sin))
    leg = Leg(x, y)
    return in_phase(phase, **{'leg': leg, 'extrinsics': ranged(distance), **changes})


@pytest.mark.parametrize('phase', STEPS)
def test_who_is_led_away_from_the_goal_fails_and_says_so(phase: Phase) -> None:
    state = then(off(1.4, phase))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == (
        f'{phase.value} leads away from the goal: 1.4 times the distance (max_excursion)'
    )
    assert then(off(1.29, phase)).phase is not Phase.FAILED


@pytest.mark.parametrize(
    ('ratio', 'bound', 'ends'), [(1.29, 1.28, True), (2.0, 2.1, False), (9.0, 0.0, False)]
)
def test_the_bound_of_the_excursion_is_a_setting_and_0_is_none(ratio, bound, ends) -> None:
    bounded = replace(SETTINGS, max_excursion=bound)
    assert (then(off(ratio), settings=bounded).phase is Phase.FAILED) is ends
    with pytest.raises(ValueError, match=r'at least 1\.05 start distances, or 0 for none, got 0'):
        replace(SETTINGS, max_excursion=0.9)


@pytest.mark.parametrize(
    'changes',
    [{'leg': None}, {'extrinsics': None}, {'extrinsics': ranged(deviation=0.26)}, {}],
    ids=['no leg', 'no belief', 'not ranged', 'no bearings'],
)
def test_a_distance_that_is_not_known_is_no_excursion(changes: dict[str, Any]) -> None:
    assert asked(excursion_limit, off(2.0), sight(), SETTINGS) != ''
    known = estimated(off(2.0).changed(**changes))
    seen = sight() if changes else sight(bearings=None)
    assert asked(excursion_limit, known, seen, SETTINGS) == ''


def test_a_law_that_leads_away_by_itself_may_do_so() -> None:
    # Without retreat a law begins with concordant epipoles as well, and backs away.
    assert asked(excursion_limit, off(2.0), sight(), replace(SETTINGS, retreat=False)) == ''


@pytest.mark.parametrize('phase', DRIVING)
def test_steps_1_and_2_end_where_they_lead_astray(phase: Phase) -> None:
    state = off(2.0, phase, travel=-1e3)
    state = seeing(state, measurement=sight())
    bounded = phase in STEPS
    assert (classify(state, SETTINGS) is Event.EXCURSION) == bounded


def test_who_may_not_back_off_at_all_does_not_and_says_what_to_do() -> None:
    settings = replace(SETTINGS, max_retreat=0.0)
    state = backing_off(settings, frames=3)
    assert (state.phase, state.motion.reversed, state.command) == (Phase.FAILED, 0.0, HALT)
    assert state.reason.startswith('the robot would have to back off, and max_retreat is 0')
    begins = then(in_phase(Phase.WAITING), SIDEWAYS, settings)
    assert (begins.phase, begins.command) == (Phase.RETREATING, HALT)
