"""Bases that do not follow slow commands, and nobody told: seen on the way, or not there."""

from dataclasses import replace
from typing import Any

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

SEED = 303
RATE = 11.0  # images a second


def driven(
    name: str, base: dict[str, float], servo: dict[str, Any], rate: float = RATE
) -> tuple[dict[str, object], ServoState]:
    """Return what became of a run at ``rate`` images a second, and the last state of its servo."""
    scenario = load(scenario_path(name)).with_servo(servo)
    camera = replace(scenario.camera, frame_rate=rate)
    base_settings = replace(scenario.base, **base)
    scenario = replace(scenario, base=base_settings, camera=camera).seeded(SEED)
    start = start_in('front', SEED, 0, scenario)
    states: list[ServoState] = []

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        states.append(step(state, seen, settings))
        return states[-1]

    loop, view = scenario.loop(start, SEED), points_of(scenario, SEED)
    log = run(loop, view, scenario.camera.nominal_camera, control=control)
    return summarise(log), states[-1]


@pytest.mark.parametrize(
    ('name', 'zone', 'rate'),
    [
        ('nominal', 0.01, RATE),
        ('nominal', 0.05, RATE),
        ('realistic', 0.01, 5.0),
        ('realistic', 0.02, 30.0),
        ('flat', 0.02, RATE),
    ],
)
def test_a_dead_band_that_nobody_told_is_found(name, zone, rate) -> None:
    untold = {'dead_band_linear': 0.0, 'dead_band_angular': 0.0}
    base = {'dead_zone_linear': zone, 'dead_zone_angular': zone}
    summary, state = driven(name, base, untold, rate)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.004
    learnt = state.dead_band
    assert zone <= max(learnt.linear.value, learnt.angular.value) <= 2.0 * zone


@pytest.mark.parametrize(
    ('name', 'base'),
    [
        ('nominal', {}),
        ('flat', {}),
        ('realistic', {}),
        ('nominal', {'command_delay': 0.3}),
        ('nominal', {'slip': 0.15, 'wheel_ratio': 1.05}),
    ],
)
def test_a_base_that_follows_teaches_none(name, base) -> None:
    summary, state = driven(name, base, {})
    assert summary['outcome'] == 'arrived', summary['reason']
    assert state.dead_band.linear.value == state.dead_band.angular.value == 0.0
