"""Bases that obey late, and nobody told: they are found out, and driven as others are."""

from dataclasses import replace

import pytest

from visual_servo_epipolar.commands.files.resources import scenario_path
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.simulation.closed_loop import run
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import points_of

SEED = 500


def driven(name: str, delay: float, **servo: object) -> tuple[dict[str, object], ServoState]:
    """Return what became of a run whose base obeys late by ``delay`` [s], and the last state."""
    scenario = load(scenario_path(name)).with_servo(servo)
    base = replace(scenario.base, command_delay=delay)
    scenario = replace(scenario, base=base).seeded(SEED)
    states: list[ServoState] = []

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        states.append(step(state, seen, settings))
        return states[-1]

    loop, view = (
        scenario.loop(start_in('front', SEED, 0, scenario), SEED),
        points_of(scenario, SEED),
    )
    log = run(loop, view, scenario.camera.nominal_camera, control=control)
    return summarise(log), states[-1]


@pytest.mark.parametrize(
    ('name', 'delay'), [('nominal', 0.5), ('nominal', 1.0), ('realistic', 0.5), ('harsh', 0.8)]
)
def test_a_base_that_obeys_late_arrives(name, delay) -> None:
    summary, state = driven(name, delay)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.006
    assert state.delay.value == pytest.approx(delay, abs=0.1)


def test_one_that_is_told_to_do_so_needs_not_to_be_found_out() -> None:
    summary, state = driven('nominal', 0.5, latency=0.55)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.002
    assert state.delay.value == 0.0


@pytest.mark.parametrize('name', ['nominal', 'flat', 'realistic', 'harsh'])
def test_one_that_obeys_at_once_is_not_taken_for_late(name) -> None:
    summary, state = driven(name, 0.0)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert state.delay.value == 0.0


def test_without_anticipation_it_goes_round_and_round() -> None:
    summary, _ = driven('nominal', 0.5, anticipation=False)
    assert summary['outcome'] == 'failed'
