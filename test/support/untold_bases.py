"""Closed loops on a base that is not as configured, and what the servo learnt of it."""

from dataclasses import replace
from typing import Any

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive


def driven(
    name: str,
    seed: int,
    base: dict[str, float],
    servo: dict[str, Any],
    rate: float | None = None,
    **camera: float,
) -> tuple[dict[str, Any], ServoState]:
    """
    Return what became of a run, and the last state of its servo.

    The scenario ``name`` with other values of its ``base``, ``servo`` and ``camera``, and ``rate``
    images a second, from the first start in front that ``seed`` gives.
    """
    scenario = load(scenario_path(name)).with_servo(servo)
    if rate is not None:
        camera['frame_rate'] = rate
    worn, seeing = replace(scenario.base, **base), replace(scenario.camera, **camera)
    scenario = replace(scenario, base=worn, camera=seeing).seeded(seed)
    states: list[ServoState] = []

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        states.append(step(state, seen, settings))
        return states[-1]

    log = drive(scenario, start_in('front', seed, 0, scenario), seed, control=control)
    return summarise(log), states[-1]
