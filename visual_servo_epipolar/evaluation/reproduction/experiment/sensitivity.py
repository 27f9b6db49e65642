"""Sensitivity of the positioning error to each perturbation of the experiment, on points."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
from typing import Any

from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.evaluation.reproduction.experiment.experiment import (
    experiment_scenario,
    FOCAL_PX,
    PRINTED_K_T,
    START,
    without,
)
from visual_servo_epipolar.evaluation.tables import markdown, number
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.simulation.closed_loop import run
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import points_of
from visual_servo_epipolar.sweeping.workers import worker_pool

SEEDS = 3
LONGEST_RUN_S = 150.0  # most come to rest within 70 s
BEHIND = (2.6, -3.0, 0.0)  # behind the goal, with both epipoles out of the image
ERRORS = ('median_error_m', 'worst_error_m', 'worst_lateral_m')
HEAD = (
    'what is wrong | arrived | error, median [mm] | worst [mm] | lateral, worst [mm] '
    '| heading, worst [deg]'
)
Change = Callable[[Scenario], Scenario]


def _with(part: str, **changes: Any) -> Change:
    def change(scenario: Scenario) -> Scenario:
        return replace(scenario, **{part: replace(getattr(scenario, part), **changes)})

    return change


# Name, whether floor and slip of the experiment are on, and what is changed then. The dead zone is
# raised, as in the paper, unless noted.
ROWS: Sequence[tuple[str, bool, tuple[Change, ...]]] = (
    ('points exact, floor even, no slip', False, (_with('points', noise=0.0),)),
    ('points to 0.2 px, as in all rows below', False, ()),
    ('points to 0.5 px', False, (_with('points', noise=0.5),)),
    ('uneven floor, 0.1 deg', False, (_with('camera', jitter=math.radians(0.1)),)),
    ('uneven floor, 0.3 deg', False, (_with('camera', jitter=math.radians(0.3)),)),
    ('slip 10 %', False, (_with('base', slip=0.1),)),
    (
        'no dead zone, none raised',
        False,
        (_with('base', dead_zone_angular=0.0), _with('servo', dead_band_angular=0.0)),
    ),
    ('dead zone 0.01 rad/s, not raised', False, (_with('servo', dead_band_angular=0.0),)),
    ('right wheel 1 % larger', False, (_with('base', wheel_ratio=1.01),)),
    ('delay of one frame', False, (_with('base', command_delay=0.09),)),
    ('camera tilted by 1 deg', False, (_with('camera', tilt=math.radians(1.0)),)),
    ('principal point 5 px off', False, (_with('camera', believed_shift_u=5.0),)),
    ('focal length 20 % too small', False, (_with('camera', believed_focal_ratio=0.8),)),
    ('all of the experiment, law as printed', True, ()),
    ('the same, true sigma', True, (_with('servo', law='corrected'),)),
    ('the same, printed k_t', True, (_with('servo', k_t=PRINTED_K_T * FOCAL_PX**2),)),
)


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Runs of one row: errors in m and deg over those that arrived."""

    name: str
    runs: int
    arrived: int
    median_error_m: float
    worst_error_m: float
    worst_lateral_m: float
    worst_heading_deg: float
    reason: str


def sensitivities(seeds: int = SEEDS) -> list[Sensitivity]:
    """Run every row with every seed, on all processors."""
    jobs = [(row, seed) for row in range(len(ROWS)) for seed in range(seeds)]
    rows, seed_numbers = zip(*jobs, strict=True)
    with worker_pool(cores(), 'run it again') as pool:
        results = list(pool.map(one, rows, seed_numbers))
    return [
        _row(ROWS[row][0], results[row * seeds : (row + 1) * seeds]) for row in range(len(ROWS))
    ]


def one(row: int, seed: int) -> Mapping[str, Any]:
    """Return the result of one run of one row."""
    _, all_perturbed, changes = ROWS[row]
    scenario = experiment_scenario(seed) if all_perturbed else without(experiment_scenario(seed))
    for change in changes:
        scenario = change(scenario)
    return from_points(scenario, START, seed)


def from_points(
    scenario: Scenario, start: tuple[float, float, float], seed: int
) -> Mapping[str, Any]:
    """Return the result of a run on point features from ``start``: x [m], y [m], [deg]."""
    loop = replace(scenario.loop(start, seed), max_duration=LONGEST_RUN_S)
    return summarise(run(loop, points_of(scenario, seed), scenario.camera.nominal_camera))


def _row(name: str, results: Sequence[Mapping[str, Any]]) -> Sensitivity:
    arrivals = [result for result in results if result['outcome'] == 'arrived']
    errors = sorted(result['position_error_m'] for result in arrivals)
    failed = [result['reason'] for result in results if result['outcome'] != 'arrived']
    worst = partial(max, default=math.nan)
    return Sensitivity(
        name=name,
        runs=len(results),
        arrived=len(arrivals),
        median_error_m=errors[len(errors) // 2] if errors else math.nan,
        worst_error_m=worst(errors),
        worst_lateral_m=worst(abs(result['lateral_error_m']) for result in arrivals),
        worst_heading_deg=worst(abs(result['heading_error_deg']) for result in arrivals),
        reason=failed[0] if failed else '',
    )


def markdown_of(rows: Sequence[Sensitivity]) -> str:
    """Return the rows as a table in Markdown."""
    cells = (
        [
            row.name,
            f'{row.arrived}/{row.runs}',
            *(number(getattr(row, name), 1, 1e3) for name in ERRORS),
            number(row.worst_heading_deg, 2),
        ]
        for row in rows
    )
    words = f'### Sensitivity of the positioning error: point features, {rows[0].runs} seeds a row'
    reasons = [f'* {row.name}: {row.reason}' for row in rows if row.reason]
    return '\n'.join([words, '', *markdown(HEAD, cells), '', *reasons]) + '\n'
