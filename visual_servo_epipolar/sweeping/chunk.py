"""Chunks: a worker drives a few starts through the closed loop and returns their results."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import groupby
from operator import itemgetter
import traceback
from typing import Any

import cv2

from visual_servo_epipolar.simulation.closed_loop import run, run_many
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.run_monitor import verdict
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import view_of
from visual_servo_epipolar.sweeping.plan import Chunk, SweepPlan

Start = tuple[float, float, float]
Result = dict[str, Any]
# Quantities that a run that raised does not have.
MISSING = (
    *('position_error_m', 'lateral_error_m', 'longitudinal_error_m', 'heading_error_deg'),
    *('duration_s', 'path_length_m', 'max_distance_ratio', 'min_visible_features'),
    *('max_linear_speed', 'max_angular_speed', 'wrong_geometry_s', 'least_time_s', 'time_ratio'),
    *('standstills', 'phase_changes', 'peak_jerk_m_s3', 'peak_jerk_rad_s3'),
)


def work(plan: SweepPlan, chunk: Chunk) -> list[Result]:
    """Do the runs of ``chunk`` and return their results in its order."""
    cv2.setNumThreads(1)  # there is a worker for each core
    results = []
    for scenario, indices in _by_scenario(plan, chunk):
        seeds = [plan.run_seed(index) for index in indices]
        starts = [
            start_in(plan.region, plan.seed, index, scenario.seeded(seed), source=plan.source)
            for index, seed in zip(indices, seeds, strict=True)
        ]
        results += run_chunk(scenario, starts, seeds, plan.source)
    return results


def _by_scenario(plan: SweepPlan, chunk: Chunk) -> Iterator[tuple[Scenario, list[int]]]:
    """Yield stretches of the chunk in one scenario; only the seeds of its runs differ."""
    scenarios = [(plan.scenario_of(chunk.law, index).seeded(0), index) for index in chunk.indices]
    for scenario, stretch in groupby(scenarios, key=itemgetter(0)):
        yield scenario, [index for _, index in stretch]


def run_chunk(
    scenario: Scenario, starts: Sequence[Start], seeds: Sequence[int], source: str
) -> list[Result]:
    """
    Drive from each start with its seed and return the JSON document of each run.

    Runs on features are driven side by side, each as it would be alone. A run that raises counts
    as failed; its result then has the key ``traceback`` as well.
    """
    if source == 'features':
        with suppress(Exception):  # a defect: one by one, below, it will say in which run
            return _side_by_side(scenario, starts, seeds)
    return [
        _alone(scenario, start, seed, source) for start, seed in zip(starts, seeds, strict=True)
    ]


def _side_by_side(
    scenario: Scenario, starts: Sequence[Start], seeds: Sequence[int]
) -> list[Result]:
    runs, rigs = [], []
    for start, seed in zip(starts, seeds, strict=True):
        seeded = scenario.seeded(seed)
        view = view_of(seeded, 'features', seed)
        runs.append((seeded.loop(start, seed), view, seeded.camera.nominal_camera))
        rigs.append(new_rig(seeded.camera))
    return [verdict(log, rig) for log, rig in zip(run_many(runs), rigs, strict=True)]


def _alone(scenario: Scenario, start: Start, seed: int, source: str) -> Result:
    seeded = scenario.seeded(seed)
    try:
        view = view_of(seeded, source, seed)
        log = run(seeded.loop(start, seed), view, seeded.camera.nominal_camera)
        return verdict(log, new_rig(seeded.camera))
    except Exception as error:  # a defect: one start must not take the other thousands along
        return {
            'outcome': 'failed',
            'reason': f'defect: {type(error).__name__}: {error}',
            'start': list(start),
            'seed': seed,
            'law': scenario.servo.law,
            **dict.fromkeys(MISSING),
            'phases': [],
            'attempts': 0,
            'traceback': traceback.format_exc(),
        }
