"""The state machine, executed: every transition, and what must always be possible."""

import pickle

import pytest
from servo_states import DRIVING, ENDED, EVENTS, goal, in_phase, PHASES, SETTINGS, sight

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.standing import ARRIVED, FAILED, HOLDING, WAITING
from visual_servo_epipolar.core.laws.two_steps import TWO_STEPS

STANDING = WAITING, HOLDING, ARRIVED, FAILED

# What each event means in each phase, written down anew on purpose: not a copy of the code.
SURVEYING = {Phase.WAITING, Phase.HOLDING}
DRIVERS = {
    Phase.ORIENTING,
    Phase.RETREATING,
    Phase.DISPLACING,
    Phase.ZEROING_EPIPOLES,
    Phase.MATCHING_FEATURES,
}
MEANING = {
    Event.NOTHING: {},
    Event.NO_BASELINE: dict.fromkeys({*SURVEYING, Phase.ZEROING_EPIPOLES}, Phase.ORIENTING),
    Event.AMBIGUOUS: dict.fromkeys(SURVEYING, Phase.MATCHING_FEATURES),
    Event.AMBIGUOUS_NEAR: dict.fromkeys(SURVEYING, Phase.RETREATING),
    Event.RESOLVED: dict.fromkeys({Phase.RETREATING, Phase.MATCHING_FEATURES}, Phase.HOLDING),
    Event.SIDEWAYS: dict.fromkeys(
        {*SURVEYING, Phase.ORIENTING, Phase.ZEROING_EPIPOLES}, Phase.RETREATING
    ),
    Event.APART: dict.fromkeys({*SURVEYING, Phase.ORIENTING, Phase.RETREATING}, Phase.DISPLACING),
    Event.ALIGNED: dict.fromkeys(
        {*SURVEYING, Phase.ORIENTING, Phase.RETREATING, Phase.ZEROING_EPIPOLES},
        Phase.MATCHING_FEATURES,
    ),
    Event.DISPLACED: {Phase.DISPLACING: Phase.ZEROING_EPIPOLES},
    Event.ESCAPED: {Phase.ZEROING_EPIPOLES: Phase.DISPLACING},
    Event.MATCHED: dict.fromkeys(
        {*SURVEYING, Phase.ORIENTING, Phase.MATCHING_FEATURES}, Phase.ARRIVED
    ),
    Event.TURNED: {Phase.MATCHING_FEATURES: Phase.ORIENTING},
    Event.MISSED: {Phase.MATCHING_FEATURES: Phase.RETREATING},
    Event.LOST: dict.fromkeys({Phase.WAITING, *DRIVERS}, Phase.HOLDING),
    Event.NO_GAIN: {
        Phase.ZEROING_EPIPOLES: Phase.DISPLACING,
        Phase.DISPLACING: Phase.FAILED,
        Phase.MATCHING_FEATURES: Phase.FAILED,
    },
    **{
        event: dict.fromkeys({*DRIVERS, Phase.HOLDING}, Phase.FAILED)
        for event in (
            Event.EXHAUSTED,
            Event.DIVERGED,
            Event.DISOBEYED,
            Event.EXCURSION,
            Event.TIMED_OUT,
        )
    },
}


@pytest.mark.parametrize('event', EVENTS)
def test_every_event_means_what_the_design_says_and_nothing_else(event: Event) -> None:
    led = {phase: TWO_STEPS.next_phase(phase, event) for phase in PHASES}
    assert led == {phase: MEANING[event].get(phase, phase) for phase in PHASES}


def reachable(start: Phase) -> set[Phase]:
    """Return the phases that some sequence of events leads to."""
    reached, new = {start}, {start}
    while new:
        new = {TWO_STEPS.next_phase(phase, event) for phase in new for event in EVENTS} - reached
        reached |= new
    return reached


def test_every_phase_is_reachable_any_run_may_end_and_then_it_stays_ended() -> None:
    assert reachable(Phase.WAITING) == set(PHASES)
    assert set(DRIVING) == DRIVERS
    for phase in (*DRIVERS, Phase.HOLDING):
        assert set(ENDED) <= reachable(phase)
    for phase in ENDED:
        assert reachable(phase) == {phase}


def test_the_names_are_those_of_the_contract() -> None:
    assert {phase.value for phase in PHASES} == {
        'waiting',
        'orienting',
        'retreating',
        'displacing',
        'zeroing_epipoles',
        'matching_features',
        'arrived',
        'holding',
        'failed',
    }


def test_no_law_overrides_what_interrupts_a_run() -> None:
    daring = {(Phase.DISPLACING, Event.LOST): Phase.MATCHING_FEATURES}
    machine = StateMachine(TWO_STEPS.rows.values(), {**TWO_STEPS.transitions, **daring})
    assert machine.next_phase(Phase.DISPLACING, Event.LOST) is Phase.HOLDING


def test_a_transition_to_a_phase_without_a_row_is_refused() -> None:
    with pytest.raises(ValueError, match='no row for zeroing_epipoles'):
        StateMachine(STANDING, {(Phase.WAITING, Event.APART): Phase.ZEROING_EPIPOLES})


def test_a_word_is_that_of_one_phase() -> None:
    with pytest.raises(ValueError, match="'holding' is defined already; choose another word"):
        Phase('holding')


@pytest.mark.parametrize('phase', PHASES)
def test_a_phase_is_the_same_object_after_a_trip_to_another_process(phase: Phase) -> None:
    assert pickle.loads(pickle.dumps(phase)) is phase


def test_the_servo_holds_in_a_phase_that_its_law_does_not_have() -> None:
    """The law was changed on the way."""
    machine = StateMachine(STANDING, {})
    row = machine.row(Phase.DISPLACING)
    state = in_phase(Phase.DISPLACING)
    assert row.command(goal(sight(), state), state, SETTINGS) == STANDSTILL
    assert row.classify(goal(sight(), state), state, SETTINGS) is Event.LOST
