"""
Consistency: errors of the estimate of the goal in closed loops, over the covariance it states.

After the first second of a run each image with a scale counts: chi square of offset and heading
by their covariance (NEES), of the offset alone and of the heading, over what is expected of it.

A covariance is a statement over all worlds that the servo allows for. In one that is exactly as
configured the deviations of mount and scale look too large, in one far off too small: so each run
draws its own, by the deviations that the servo goes by.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.map_state import BY_COMMANDS
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.settings import updated
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.evaluation.tables import cells, Columns, markdown, numbers
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load, Scenario
from visual_servo_epipolar.sweeping.plan import Run, run_of
from visual_servo_epipolar.sweeping.provenance import commit

SCENARIOS, LAWS = ('nominal', 'realistic', 'harsh', 'cheap'), ('full', 'smooth')
STARTS = 12
PARTS = {'nees': [0, 1, 2], 'offset': [0, 1], 'heading': [2]}
COLUMNS: Columns = {
    'scenario': lambda row: str(row['scenario']),
    'law': lambda row: f'`{row["law"]}`',
    'images': lambda row: str(row['images']),
    'offset and heading': lambda row: numbers(row['nees'], 2),
    'offset': lambda row: numbers(row['offset'], 2),
    'heading': lambda row: numbers(row['heading'], 2),
}


def drawn(scenario: Scenario, seed: int) -> Scenario:
    """Return the scenario with a mount about its own and a slip, drawn as the servo expects."""
    rng = np.random.default_rng((seed, 8))  # 8: apart from other draws of one seed
    yaw, forward, left, way = rng.standard_normal(4).tolist()
    camera, servo = scenario.camera, scenario.servo
    camera = replace(
        camera,
        mount_yaw=camera.mount_yaw + servo.camera_yaw_deviation * yaw,
        mount_forward=camera.mount_forward + servo.camera_forward_deviation * forward,
        mount_left=camera.mount_left + servo.camera_left_deviation * left,
    )
    slip = abs(BY_COMMANDS.scale_deviation * way)
    return replace(scenario, camera=camera, base=updated(scenario.base, {'slip': slip}, 'base'))


def ratios(estimate: GoalEstimate, pose: Pose) -> list[float]:
    """Return chi square over its expected value of each of PARTS, at the true ``pose``."""
    right, ahead = estimate.offset or (math.nan, math.nan)
    turn = math.remainder(estimate.heading_error - pose.heading_error, 2.0 * math.pi)
    error = np.array([right - pose.x, ahead - pose.y, turn])
    return [
        float(error[it] @ np.linalg.solve(estimate.pose_covariance[np.ix_(it, it)], error[it]))
        / len(it)
        for it in PARTS.values()
    ]


def ratios_of_run(settings: Run) -> Iterator[list[float]]:
    """Drive a run, and yield the ratios of its images."""
    found: list[tuple[Pose, GoalEstimate]] = []
    loop = Loop(*settings)

    def control(state: ServoState, seen: Observation, servo: ServoSettings) -> ServoState:
        after = step(state, seen, servo)
        if after.measurement is not None and after.phase.runs:
            found.append((loop.driven.shown, after.measurement))
        return after

    loop.run(control=control)
    for pose, estimate in found:
        late = seconds_between(found[0][1].stamp_ns, estimate.stamp_ns) > 1.0  # [s]
        if late and np.isfinite(estimate.pose_covariance).all():
            yield ratios(estimate, pose)


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive from the same starts in each scenario, by each law, and return a row for each."""
    starts, rows = 1 if quick else STARTS, []
    for name in SCENARIOS[: 1 if quick else None]:
        for law in LAWS:
            scenario = load(scenario_path(name)).with_servo({'law': law})
            found: list[list[float]] = []
            for number in range(starts):
                say(f'consistency: {name}, {law}: run {number + 1} of {starts} ...')
                own = seed + number
                world = drawn(scenario, own)
                start = start_in('front', seed, number, world.seeded(own))
                found += ratios_of_run(run_of(world, start, own, 'features'))
            both = np.percentile(np.array(found or [[math.nan] * len(PARTS)]), (50, 95), axis=0)
            parts = {part: both[:, column].tolist() for column, part in enumerate(PARTS)}
            rows.append({'scenario': name, 'law': law, 'images': len(found), **parts})
    return {'starts': starts, 'seed': seed, 'commit': commit(), 'rows': rows}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown: one row a scenario and law."""
    words = (
        f'{document["starts"]} starts in front, each in a world of its own, point features; chi '
        f'square over its expected value, median / p95; seed {document["seed"]}, commit '
        f'{document["commit"]}.'
    )
    return '\n'.join([words, '', *markdown(' | '.join(COLUMNS), cells(COLUMNS, document['rows']))])
