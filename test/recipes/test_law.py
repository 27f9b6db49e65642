"""A law and a base from another package, as in docs/extending.md."""

from dataclasses import dataclass, replace
import math

import pytest
from untold_bases import driven

from visual_servo_epipolar.core.bases.base import BaseLimits
from visual_servo_epipolar.core.bases.differential_drive import DifferentialDrive
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.conditions import leads_home
from visual_servo_epipolar.core.laws.machine import PhaseRow, StateMachine
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.registry import phase_colour, phase_row, sentence
from visual_servo_epipolar.core.laws.two_steps import FULL, TWO_STEPS
from visual_servo_epipolar.core.servo.settings import ServoSettings

SPEED = 0.2  # [m/s]

# What the other package writes: a phase, its row, and a law whose machine has it for step 1.
PURSUING = Phase('pursuing', drives=True, closes_in=True)
CLOSE = Event('close', 'a straight line leads home')


def classify(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if goal.is_untrusted(settings.near_parallax) or goal.bearings is None:
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
    assert result['position_error_m'] < 2e-3
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


FASTEST = 0.15  # of the tracks, whatever the settings allow [m/s]


@dataclass(frozen=True, slots=True)
class Tracks(DifferentialDrive):
    """Tracks, which turn in place but are slow."""

    def within_speed(self, wanted: Twist, *, ratio: float = 1.0) -> Twist:
        limits = replace(self.limits, max_linear=min(FASTEST, self.limits.max_linear))
        return DifferentialDrive(limits).within_speed(wanted, ratio=ratio)


def tracks(limits: BaseLimits) -> Tracks:
    return Tracks(limits)


def lorry(limits: BaseLimits) -> Tracks:
    return Tracks(limits, max_curvature=0.5)


def test_the_servo_drives_a_base_of_another_package(install) -> None:
    install('bases', 'tracks', f'{__name__}:tracks')
    slow, state = driven('nominal', 5, {}, {'base': 'tracks'})
    assert slow['outcome'] == 'arrived', slow['reason']
    assert 0.9 * FASTEST < slow['max_linear_speed'] <= FASTEST + 1e-12
    usual, _ = driven('nominal', 5, {}, {})
    assert usual['max_linear_speed'] > 2.0 * FASTEST


def test_a_law_that_turns_in_place_refuses_a_base_that_does_not(install) -> None:
    install('bases', 'lorry', f'{__name__}:lorry')
    with pytest.raises(ValueError, match='orienting, base lorry drives curves of 0.5 1/m at most'):
        ServoSettings(base='lorry', law='full')
