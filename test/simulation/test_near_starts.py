"""Starts so near the goal that a baseline shows in one image and not in the next."""

import pytest

from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import drive

# x, y, heading error and the seed; the first four turned to and fro for as long as they might.
STARTS = [
    (0.1, 0.0, -20.0, 3),
    (-0.131, -0.017, 15.51, 29),
    (-0.109, -0.039, 0.47, 12),
    (-0.093, -0.027, -12.44, 59),
    *((0.05 * k, 0.02 * (-1) ** k, 12.0 * (k % 5 - 2), k + 4) for k in range(-4, 5) if k),
    *((0.02 * (-1) ** k, 0.05 * k, 12.0 * (k % 4 - 1.5), k + 20) for k in range(-4, 5) if k),
]


@pytest.mark.long
def test_every_start_near_the_goal_arrives_and_faces_it_soon() -> None:
    logs = [drive(Scenario().seeded(seed), tuple(start), seed) for *start, seed in STARTS]
    assert [log.reason for log in logs if log.outcome != 'arrived'] == []
    for log in logs:
        spans = summarise(log)['phases']
        turning = sum(s['end_s'] - s['start_s'] for s in spans if s['name'] == 'orienting')
        assert turning < 30.0, log.start
