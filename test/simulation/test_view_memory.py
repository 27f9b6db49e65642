"""The memory of views in closed loops: before one wall two views know little near the goal."""

from itertools import pairwise
import math
from typing import Any

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.servo.run_log import Sample, summarise
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load, Scenario
from visual_servo_epipolar.simulation.views import drive

SEED, STARTS = 3, 2


def driven_from(
    start: tuple[float, float, float], name: str = 'nominal', seed: int = SEED, **servo: bool
) -> tuple[dict[str, Any], float, float]:
    """Return what became of a run, its largest distance from the goal and its way [m]."""
    scenario = load(scenario_path(name)).with_servo(servo).seeded(seed)
    samples: list[Sample] = []
    log = drive(scenario, start, seed, watch=samples.append)
    places = [(each.pose.x, each.pose.y) for each in samples]
    way = sum(math.dist(*pair) for pair in pairwise(places))
    return summarise(log), max(math.hypot(*place) for place in places), way


def test_wheels_that_hop_end_where_they_can() -> None:
    """A millimetre is the least that they move: more is not asked of them, for two minutes."""
    summary, _, _ = driven_from(start_in('front', 300, 302, Scenario()), 'realistic', 302)
    assert summary['outcome'] == 'arrived'
    assert summary['duration_s'] < 40.0


@pytest.mark.parametrize(
    ('x', 'y', 'heading'), few_of([(0.05, 0.0, 0.0), (-0.05, 0.0, 0.0), (0.035, -0.035, 3.0)])
)
def test_from_5_cm_aside_a_quarter_of_a_metre_is_enough(x, y, heading) -> None:
    summary, farthest, _ = driven_from((x, y, heading))
    assert summary['outcome'] == 'arrived'
    assert summary['position_error_m'] < 0.0015
    assert farthest < 0.27


@pytest.mark.parametrize('seed', few_of(range(300, 303)))
def test_from_1_cm_aside_it_drives_half_a_metre_in_all(seed) -> None:
    summary, _, way = driven_from((0.01, 0.0, 0.0), seed=seed)
    assert summary['outcome'] == 'arrived'
    assert summary['position_error_m'] < 0.002
    assert way < 0.8  # one of them loses its baseline for a frame, and backs off once more


@pytest.mark.parametrize('seed', few_of([303, 304, 305]))
def test_before_a_wall_a_centimetre_aside_is_not_taken_for_the_goal(seed) -> None:
    """A turn explains all but a tenth of a pixel of it."""
    summary, farthest, _ = driven_from((-0.01, 0.0, 0.0), 'flat', seed)
    assert summary['outcome'] == 'arrived'
    assert farthest > 0.2
    # Of 32 such starts the median is 2.1 mm, and the worst 9.0.
    assert summary['position_error_m'] < 0.01


@pytest.mark.parametrize('name', ['nominal', 'flat', 'realistic', 'harsh'])
def test_at_the_goal_a_look_is_enough(name) -> None:
    summary, farthest, _ = driven_from((0.0, 0.0, 0.0), name)
    assert summary['outcome'] == 'arrived'
    assert farthest < 0.001


@pytest.mark.long
def test_before_one_wall_the_memory_ends_nearer() -> None:
    starts = [start_in('front', SEED, index, Scenario()) for index in range(STARTS)]
    remembering, forgetful = (
        [driven_from(it, 'flat', SEED + k, memory=memory)[0] for k, it in enumerate(starts)]
        for memory in (True, False)
    )
    errors = [run['position_error_m'] for run in remembering]
    assert [run['outcome'] for run in remembering] == ['arrived'] * STARTS
    assert max(errors) < 0.004  # measured: 1.4 mm in the median, 2.0 at most
    assert np.median([run['position_error_m'] for run in forgetful]) > max(errors)


# x, y, heading error and the seed; the first four turned to and fro for as long as they might.
NEAR_STARTS = [
    (0.1, 0.0, -20.0, 3),
    (-0.131, -0.017, 15.51, 29),
    (-0.109, -0.039, 0.47, 12),
    (-0.093, -0.027, -12.44, 59),
    *((0.05 * k, 0.02 * (-1) ** k, 12.0 * (k % 5 - 2), k + 4) for k in range(-4, 5) if k),
    *((0.02 * (-1) ** k, 0.05 * k, 12.0 * (k % 4 - 1.5), k + 20) for k in range(-4, 5) if k),
]


@pytest.mark.long
def test_every_start_near_the_goal_arrives_and_faces_it_soon() -> None:
    logs = [drive(Scenario().seeded(seed), tuple(start), seed) for *start, seed in NEAR_STARTS]
    assert [log.reason for log in logs if log.outcome != 'arrived'] == []
    for log in logs:
        spans = summarise(log)['phases']
        turning = sum(s['end_s'] - s['start_s'] for s in spans if s['name'] == 'orienting')
        assert turning < 30.0, log.start
