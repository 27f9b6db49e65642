"""
What small images, few features and other rates cost in accuracy, for docs/results.md.

Closed loops on rendered images from the same starts in `front`, furnished room and poor texture.
Usage: python small_computer_arrivals.py [STARTS]
"""

from collections.abc import Sequence
from itertools import product
import sys
from typing import TypeAlias

from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.simulation.scenario import from_document, Scenario
from visual_servo_epipolar.sweeping.plan import Chunk, SweepPlan
from visual_servo_epipolar.sweeping.summary import Result, summary_of
from visual_servo_epipolar.sweeping.workers import local_workers

STARTS, SEED, LAW, FULL_WIDTH, FULL_FOCAL = 8, 31, 'full', 1280, 769.2307692307693
SIZES, FEATURES, RATES = ((320, 240), (640, 480)), (30, 60), (5.0, 11.0, 20.0)
SCENES = {'room': 'furnished', 'plain': 'poor texture'}

Cell: TypeAlias = tuple[tuple[int, int], str, int, float]


def main(starts: int) -> None:
    """Print one row for each size, scene, number of features, and rate."""
    cells = [(*cell, 11.0) for cell in product(SIZES, SCENES, FEATURES)]
    cells += [((640, 480), 'room', 30, rate) for rate in RATES if rate != 11.0]
    print('| images | scene | features | images a second | arrived | mm, median / p95 / max |')
    print('|---|---|---|---|---|---|')
    with local_workers(cores()) as workers:
        jobs = []
        for cell in cells:
            plan = SweepPlan(
                region='front',
                runs=starts,
                source='images',
                laws=(LAW,),
                scenario=scenario(*cell),
                seed=SEED,
            )
            jobs.append([workers.submit(plan, Chunk(LAW, (run,))) for run in range(starts)])
        for cell, parts in zip(cells, jobs, strict=True):
            print(row(cell, [result for part in parts for result in part.result()]), flush=True)


def scenario(size: tuple[int, int], scene: str, features: int, rate: float) -> Scenario:
    """Return the nominal scenario seen by a small camera and tracker."""
    camera = {
        'width': size[0],
        'height': size[1],
        'focal_length': FULL_FOCAL * size[0] / FULL_WIDTH,
        'principal_u': 0.5 * (size[0] - 1),
        'principal_v': 0.5 * (size[1] - 1),
        'frame_rate': rate,
        'scene': scene,
    }
    tracker = {'max_features': features, 'min_features': 2 * features // 3}
    return from_document({'camera': camera, 'tracker': tracker}, 'a small computer')


def row(cell: Cell, results: Sequence[Result]) -> str:
    """Return the row of one cell."""
    (width, height), scene, features, rate = cell
    summary = summary_of(results)
    errors = summary['position_error_m']
    cells = ' / '.join(f'{1e3 * errors[name]:.1f}' for name in ('median', 'p95', 'max'))
    return (
        f'| {width}x{height} | {SCENES[scene]} | {features} | {rate:g} | '
        f'{summary["arrived"]} of {len(results)} | {cells} |'
    )


if __name__ == '__main__':
    main(int(sys.argv[1]) if len(sys.argv) > 1 else STARTS)
