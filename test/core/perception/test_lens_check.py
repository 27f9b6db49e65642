"""A camera_info that the tracks contradict is said; a right one never is."""

from dataclasses import replace
from itertools import product
import re

from durations import few_of
import pytest

from visual_servo_epipolar.core.perception.lens_check import LensCheck, looked_at, UNKNOWN
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import step
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import drive

STARTS = [(0.8, -3.0, 0.0), (-0.6, -2.4, 12.0), (0.2, -3.4, -10.0)]
LONGEST_S = 20.0
ROLLING = {'readout': 0.033, 'frame_rate': 15.0}


def doubts(start: tuple[float, float, float], **camera: float) -> list[str]:
    """Return what is said over a drive of the servo on point features."""
    scenario = Scenario()
    scenario = replace(
        scenario,
        camera=replace(scenario.camera, **camera),
        run=replace(scenario.run, max_duration=LONGEST_S),
    )
    checks = [LensCheck()]

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        after = step(state, seen, settings)
        if after.measurement is not None and after.view.memory is not None:
            run_so_far = after.measurement, after.view.memory
            checks.append(looked_at(checks[-1], seen, run_so_far, settings, after.view.frame))
        return after

    drive(scenario, start, 3, control=control)
    assert checks[-1].memory is not None
    assert checks[-1].memory.lens.ratio_deviation < UNKNOWN
    return [check.doubt for check in checks if check.doubt]


# The third start moves too little sideways to tell; 0.1 m farther aside it can.
@pytest.mark.parametrize(
    ('ratio', 'start'),
    few_of(
        [
            *product([0.75, 1.25], [(0.3, -3.4, -10.0)]),
            *product([0.75, 0.9, 1.1, 1.25], STARTS[:2]),
        ],
        keep=(0,),
    ),
)
def test_a_wrong_focal_length_is_said_with_the_right_one(
    ratio: float, start: tuple[float, float, float]
) -> None:
    told = doubts(start, believed_focal_ratio=ratio)
    numbers = [int(text) for text in re.findall(r'(\d+) px', told[-1])]
    assert numbers[0] == pytest.approx(ratio * 769.2, rel=0.01)
    assert numbers[1] == pytest.approx(769.2, rel=0.05)


@pytest.mark.parametrize(
    ('camera', 'start'),
    few_of(
        [*product([{}, {'tilt': 0.25, 'roll': 0.1}, {'mount_yaw': 0.09}, ROLLING], STARTS)],
        keep=(4, 10),
    ),
)
def test_a_right_one_is_never_doubted(
    start: tuple[float, float, float], camera: dict[str, float]
) -> None:
    assert doubts(start, **camera) == []
