"""A wall near the goal: two geometries fit it, and a short way tells which is true."""

from durations import few_of
import pytest

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive

STARTS = [
    *((0.92, -2.58, 0.46), (-0.52, -2.03, -9.37), (1.19, -2.38, -14.44), (1.2, -1.0, 10.0)),
    *((1.32, -4.39, -5.66), (-1.4, -3.41, 8.8)),  # far off, places are noisy
]


@pytest.mark.parametrize('law', ['full', 'smooth'])
@pytest.mark.parametrize(('x', 'y', 'heading'), few_of(STARTS, keep=(1, 4)))
def test_the_robot_probes_and_arrives(x: float, y: float, heading: float, law: str) -> None:
    scenario = load(scenario_path('nearwall')).with_servo({'law': law})
    log = drive(scenario, (x, y, heading), 0)
    assert log.samples[-1].phase.value == 'arrived', log.reason
    assert log.samples[-1].pose.distance < 5e-3
    assert y > -2.0 or summarise(log)['max_distance_ratio'] < 1.3
