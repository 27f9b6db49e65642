"""Recipe of a law: another package brings one with a phase of its own, and the servo drives."""

from dataclasses import replace
import math

import pytest
from untold_bases import driven

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.conditions import is_untrusted, leads_home
from visual_servo_epipolar.core.laws.machine import PhaseRow, StateMachine
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.registry import phase_colour, phase_row, sentence
from visual_servo_epipolar.core.laws.two_steps import FULL, TWO_STEPS

SPEED = 0.2  # [m/s]

# What the other package writes: a phase, its row, and a law whose machine has it for step 1.
PURSUING = Phase('pursuing', drives=True, closes_in=True)
CLOSE = Event('close', 'a straight line leads home')


def classify(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if is_untrusted(goal, settings) or goal.bearings is None:
        return Event.LOST
    return CLOSE if leads_home(goal, settings) else Event.NOTHING


def command(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return the twist of Park and Kuipers (2011), along one curve to the axis of the goal."""
    assert goal.bearings is not None
    delta = -math.remainder(goal.bearings.phi + math.pi, 2.0 * math.pi)
    aside = -math.remainder(goal.bearings.psi + 0.5 * math.pi, 2.0 * math.pi)
    turn = 3.0 * (delta + math.atan(aside)) + (1.0 + 1.0 / (1.0 + aside**2)) * math.sin(delta)
    return Twist(SPEED, -SPEED * turn / goal.distance())


ROW = PhaseRow(
    phase=PURSUING,
    words='curves onto the axis of the photograph',
    colour='#8C510A',
    classify=classify,
    command=command,
)
PURSUIT = replace(
    FULL,
    machine=StateMachine(
        (*TWO_STEPS.rows.values(), ROW),
        {
            **TWO_STEPS.transitions,
            (Phase.WAITING, Event.APART): PURSUING,
            (Phase.HOLDING, Event.APART): PURSUING,
            (PURSUING, CLOSE): Phase.MATCHING_FEATURES,
        },
    ),
)


@pytest.fixture(autouse=True)
def pursuit(install) -> None:
    install('laws', 'pursuit', f'{__name__}:PURSUIT')


def test_a_law_with_a_phase_of_its_own_arrives() -> None:
    result, _ = driven('nominal', 5, {}, {'law': 'pursuit'})
    assert result['outcome'] == 'arrived', result['reason']
    assert float(str(result['position_error_m'])) < 2e-3
    names = [item['name'] for item in result['phases']]  # type: ignore[attr-defined]
    assert names[0] == 'pursuing' and 'displacing' not in names


def test_its_words_and_colour_come_from_the_row() -> None:
    assert phase_row('pursuing') is ROW
    assert phase_colour('pursuing') == ROW.colour
    assert sentence(PURSUING, CLOSE.value) == (
        'pursuing: the robot curves onto the axis of the photograph; a straight line leads home'
    )
    assert sentence(Phase.MATCHING_FEATURES, CLOSE.value).endswith('; a straight line leads home')


def test_a_broken_law_of_another_package_is_no_obstacle(install) -> None:
    install('laws', 'a_broken_one', 'no_such_module:LAW')
    assert phase_row('pursuing') is ROW
    assert phase_row('of no law') is None
