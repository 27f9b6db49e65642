"""Bases that obey late, and nobody told: they are found out, and driven as others are."""

from durations import few_of
import pytest
import untold_bases

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive

SEED = 501
DEAF_IMAGES = 10  # 0.9 s


def driven(
    name: str, delay: float, base: dict[str, float] | None = None, **servo: object
) -> tuple[dict[str, object], ServoState]:
    """Return what became of a run whose base obeys late by ``delay`` [s], and the last state."""
    return untold_bases.driven(name, SEED, {'command_delay': delay, **(base or {})}, servo)


@pytest.mark.parametrize(
    ('name', 'delay'),
    few_of([('nominal', 1.0), ('realistic', 0.5), ('nominal', 0.5), ('harsh', 0.8)], keep=(1,)),
)
def test_a_base_that_obeys_late_arrives(name, delay) -> None:
    summary, state = driven(name, delay)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.006
    assert state.identified.delay.value == pytest.approx(delay, abs=0.1)


def test_one_that_is_told_to_do_so_needs_not_to_be_found_out() -> None:
    summary, state = driven('nominal', 0.5, latency=0.55)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.002
    assert state.identified.delay.value == 0.0


@pytest.mark.parametrize('name', few_of(['nominal', 'harsh', 'flat', 'realistic']))
def test_one_that_obeys_at_once_is_not_taken_for_late(name) -> None:
    summary, state = driven(name, 0.0)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert state.identified.delay.value == 0.0


@pytest.mark.long
def test_without_anticipation_it_goes_round_and_round() -> None:
    summary, _ = driven('nominal', 0.5, anticipation=False)
    assert summary['outcome'] == 'failed'


def test_a_dead_band_is_found_behind_a_delay() -> None:
    """Its pulses are shorter than the time between two images in which they act."""
    summary, state = driven('nominal', 0.45, {'dead_zone_linear': 0.03})
    assert summary['outcome'] == 'arrived', summary['reason']
    assert state.identified.dead_band.linear.value >= 0.03


@pytest.mark.long
def test_gains_that_are_derived_know_that_laws_look_ahead() -> None:
    summary, _ = driven('nominal', 0.5, gains='derived')
    assert summary['outcome'] == 'arrived', summary['reason']


def test_a_base_that_begins_late_once_is_driven_as_others_are() -> None:
    """Brakes that open late: what is learnt of it, if anything, is unlearnt."""
    scenario = load(scenario_path('nominal')).seeded(502)
    states: list[ServoState] = []

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        states.append(step(state, seen, settings))
        turning = [it for it in states if it.twist.angular]
        if len(turning) <= DEAF_IMAGES:  # the base does not hear of it
            return states[-1].changed(command=Command(STANDSTILL))
        return states[-1]

    start = start_in('front', SEED, 2, scenario)
    summary = summarise(drive(scenario, start, 502, control=control))
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.003
    assert states[-1].identified.delay.value == 0.0
