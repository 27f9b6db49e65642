"""Control laws beside ours: shared starts, features, base and measure of success."""

from collections.abc import Callable, Mapping
from dataclasses import replace
import math
from operator import itemgetter
from typing import Any

from visual_servo_epipolar.core.servo.run_log import summarise, WRONG_DEG, WRONG_M
from visual_servo_epipolar.evaluation.benchmarks.peers import drive_by_pose, PEERS, POSE_LAWS
from visual_servo_epipolar.evaluation.tables import aligned, cells, Columns, number, numbers
from visual_servo_epipolar.simulation.closed_loop import run as drive
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import points_of
from visual_servo_epipolar.sweeping.summary import quantile

REGIONS = ('front', 'beside')
# One motion by images, and laws of the same kind that are given the true pose.
SMOOTH = 'smooth'
LAWS = (*PEERS, SMOOTH, *POSE_LAWS)
STARTS, QUICK_STARTS = 20, 1
LONGEST_S = 120.0
COLUMNS: Columns = {
    'region': itemgetter('region'),
    'law': itemgetter('law'),
    'reached %': lambda row: f'{100.0 * row["reached"]:.0f}',
    'lost %': lambda row: f'{100.0 * row["lost"]:.0f}',
    'wrong %': lambda row: f'{100.0 * row["wrong"]:.0f}',
    'position med / p95 mm': lambda row: numbers(
        (row['position_median_m'], row['position_p95_m']), 1, 1e3
    ),
    'heading deg': lambda row: number(row['heading_median_deg'], 2),
    'path / d_0': lambda row: number(row['path_ratio'], 2),
    'time s': lambda row: number(row['duration_s'], 0),
    'time / T_0 med / p95': lambda row: numbers((row['time_ratio'], row['time_ratio_p95']), 2),
    'fewest features': lambda row: f'{row["fewest_features"]:.0f}',
}

Run = dict[str, Any]


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive every law from every start, and return all runs and a row of figures for each law."""
    count = QUICK_STARTS if quick else STARTS
    runs = []
    for region in REGIONS:
        for index in range(count):
            start = start_in(region, seed, index, Scenario())
            for law in LAWS:
                say(f'laws: {region} {index + 1} of {count}, {law} ...')
                runs.append(one_run(law, start, seed + index) | {'region': region})
    return {
        'starts': count,
        'seed': seed,
        'longest_s': LONGEST_S,
        'reached': {'position_m': WRONG_M, 'heading_deg': WRONG_DEG},
        'rows': [
            {'law': law, 'region': region}
            | scores([it for it in runs if (it['law'], it['region']) == (law, region)])
            for region in REGIONS
            for law in LAWS
        ],
        'runs': runs,
    }


def one_run(law: str, start: tuple[float, float, float], seed: int) -> Run:
    """Return the result of one run of ``law`` from ``start``: x [m], y [m], heading [deg]."""
    scenario = Scenario().seeded(seed)
    servo = scenario.servo
    if law == SMOOTH:
        servo = replace(servo, law=SMOOTH)
    elif law != 'ours':
        servo = replace(servo, min_parallax=1.0)  # of trusted bearings [px]
    scenario = replace(scenario, run=replace(scenario.run, max_duration=LONGEST_S), servo=servo)
    loop, view = scenario.loop(start, seed), points_of(scenario, seed)
    if law in POSE_LAWS:
        log = drive_by_pose(law, loop, view, scenario.camera.camera)
    else:
        control = PEERS['ours' if law == SMOOTH else law]
        log = drive(loop, view, scenario.camera.camera, control=control)
    summary = summarise(log)
    return summary | {'law': law, 'fate': _fate(summary)}


def _fate(summary: Mapping[str, Any]) -> str:
    """Return how a run ended by ground truth; what the robot reports is ``outcome``."""
    position, heading = summary['position_error_m'], abs(summary['heading_error_deg'])
    if position <= WRONG_M and heading <= WRONG_DEG:
        return 'reached'
    return 'lost' if 'features' in summary['reason'] and 'lost' in summary['reason'] else 'missed'


def scores(runs: list[Run]) -> dict[str, float]:
    """Return the figures of one row; what no run reached is nan."""
    reached = [it for it in runs if it['fate'] == 'reached']
    seeing = [it for it in runs if it['fate'] != 'lost']
    wrong = [it for it in runs if it['outcome'] == 'arrived' and it['fate'] != 'reached']

    def spread(of: list[Run], name: str, share: float) -> float:
        return quantile([abs(it[name]) for it in of], share)

    ratios = [it['path_length_m'] / math.hypot(*it['start'][:2]) for it in reached]
    return {
        'runs': len(runs),
        'reached': len(reached) / len(runs),
        'lost': sum(it['fate'] == 'lost' for it in runs) / len(runs),
        'wrong': len(wrong) / len(runs),
        'position_median_m': spread(seeing, 'position_error_m', 0.5),
        'position_p95_m': spread(seeing, 'position_error_m', 0.95),
        'heading_median_deg': spread(seeing, 'heading_error_deg', 0.5),
        'path_ratio': quantile(ratios, 0.5),
        'duration_s': spread(reached, 'duration_s', 0.5),
        'time_ratio': spread(reached, 'time_ratio', 0.5),
        'time_ratio_p95': spread(reached, 'time_ratio', 0.95),
        'fewest_features': spread(runs, 'min_visible_features', 0.0),
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a law and region."""
    reached = document['reached']
    return '\n'.join(
        [
            f'Laws: {document["starts"]} starts a region, point features at 0.2 px, at most '
            f'{document["longest_s"]:g} s; reached means within {reached["position_m"]:g} m and '
            f'{reached["heading_deg"]:g} deg',
            '(lost: the features; wrong: arrived, it says, but not reached; position and heading '
            'of all that did not lose the features, path and time of those that reached; T_0: the '
            'least time of docs/results.md; graceful and displaced are given the true pose)',
            '',
            *aligned(' | '.join(COLUMNS), cells(COLUMNS, document['rows']), left=2),
        ]
    )
