"""Calibration errors in closed loop (section VI): arrivals and position errors by f_hat / f."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.simulation.closed_loop import run_many
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import points_of

RATIOS = (0.17, 0.25, 0.5, 0.75, 1.0)  # f_hat / f
SHIFT_PX = 10.0  # of the principal point, to the right and down
REGIONS = ('front', 'beside')
MOUNTS = {'above the axle': 0.0, '0.13 m ahead': 0.13}
STARTS, FEW_STARTS, AHEAD_STARTS = 64, 16, 32
QUICK_CELL = ('above the axle', 'front', 0.25)
WRONG_M, WRONG_DEG = 0.05, 2.0

Result = dict[str, Any]


@dataclass(frozen=True)
class Method:
    """What the servo does about the camera matrix, and how many starts a mount and region has."""

    settings: Mapping[str, Any]
    starts: Mapping[str, int]
    regions: tuple[str, ...] = REGIONS


EVERYWHERE = dict(zip(MOUNTS, (STARTS, AHEAD_STARTS), strict=True))
FEW = dict.fromkeys(tuple(MOUNTS)[:1], FEW_STARTS)
METHODS: Mapping[str, Method] = {
    'found out': Method({'focal_deviation': 1.0}, EVERYWHERE),
    'believed': Method({}, FEW, REGIONS[:1]),
    'planar_3dof': Method({'estimator': 'planar_3dof'}, FEW, REGIONS[:1]),
}


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive with each camera matrix, all from one set of starts, and return rows and runs."""
    rows = []
    for name, mount, region, ratio, starts in _cells(quick):
        say(f'calibration: {name}, camera {mount}, {region}, f_hat/f = {ratio:g} ...')
        results = _results(_scenario(name, mount, ratio), region, seed, starts)
        row = {'method': name, 'mount': mount, 'region': region, 'ratio': ratio}
        rows.append(row | scores(results) | {'runs': results})
    return {'seed': seed, 'shift_px': SHIFT_PX, 'rows': rows}


def _cells(quick: bool) -> Iterator[tuple[str, str, str, float, int]]:
    for name, method in METHODS.items():
        for mount, starts in method.starts.items():
            for region in method.regions:
                for ratio in RATIOS:
                    if not quick:
                        yield name, mount, region, ratio, starts
                    elif (mount, region, ratio) == QUICK_CELL:
                        yield name, mount, region, ratio, 2


def _scenario(name: str, mount: str, ratio: float) -> Scenario:
    plain = Scenario().with_servo(METHODS[name].settings)
    camera = replace(
        plain.camera,
        mount_forward=MOUNTS[mount],
        believed_focal_ratio=ratio,
        believed_shift_u=SHIFT_PX,
        believed_shift_v=SHIFT_PX,
    )
    return replace(plain, camera=camera)


def _results(scenario: Scenario, region: str, seed: int, starts: int) -> list[Result]:
    runs = []
    for index in range(starts):
        seeded = scenario.seeded(seed + index)
        start = start_in(region, seed, index, seeded)
        view = points_of(seeded, seed + index)
        runs.append((seeded.loop(start, seed + index), view, seeded.camera.nominal_camera))
    return [summarise(log) for log in run_many(runs)]


def scores(results: Sequence[Result]) -> dict[str, Any]:
    """Return the figures of one row, by ground truth; of no arrivals they are nan."""
    arrived = [result for result in results if result['outcome'] == 'arrived']
    wrong = [result for result in arrived if _is_wrong(result)]

    def quantile(name: str, share: float) -> float:
        values = [abs(result[name]) for result in arrived]
        return float(np.quantile(values, share)) if values else math.nan

    return {
        'starts': len(results),
        'arrived': len(arrived),
        'wrong': len(wrong),
        'position_median_m': quantile('position_error_m', 0.5),
        'position_p95_m': quantile('position_error_m', 0.95),
        'position_max_m': quantile('position_error_m', 1.0),
        'heading_median_deg': quantile('heading_error_deg', 0.5),
        'heading_p95_deg': quantile('heading_error_deg', 0.95),
        'duration_s': quantile('duration_s', 0.5),
        'reasons': sorted(
            {result['reason'] for result in results if result['outcome'] != 'arrived'}
        ),
    }


def _is_wrong(result: Result) -> bool:
    far = result['position_error_m'] > WRONG_M
    return bool(far or abs(result['heading_error_deg']) > WRONG_DEG)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a camera matrix, region, mount and method."""
    lines = [
        f'A principal point {document["shift_px"]:g} px off to the right and down, and '
        'f_hat / f times the focal length; point features at 0.2 px',
        f'(wrong: says that it has arrived, and is {WRONG_M:g} m or {WRONG_DEG:g} deg off; errors '
        'of the runs that arrived)',
        '',
        f'{"matrix":<13}{"camera":<16}{"region":<8}{"f_hat/f":>8}{"arrived":>10}{"wrong":>7}'
        f'{"position med/p95/max":>22}{"heading med/p95":>17}{"time":>7}',
        f'{"":<13}{"":<16}{"":<8}{"":>8}{"":>10}{"":>7}{"mm":>22}{"deg":>17}{"s":>7}',
    ]
    return '\n'.join(lines + [_row(result) for result in document['rows']])


def _row(result: Mapping[str, Any]) -> str:
    names = ('position_median_m', 'position_p95_m', 'position_max_m')
    position = '/'.join(_number(1e3 * result[name], 1) for name in names)
    heading = '/'.join(_number(result[f'heading_{name}_deg'], 2) for name in ('median', 'p95'))
    return (
        f'{result["method"]:<13}{result["mount"]:<16}{result["region"]:<8}{result["ratio"]:8.2f}'
        f'{result["arrived"]:6d}/{result["starts"]:<3d}{result["wrong"]:7d}{position:>22}{heading:>17}'
        f'{_number(result["duration_s"], 0):>7}'
    )


def _number(value: float, digits: int) -> str:
    return '-' if math.isnan(value) else f'{value:.{digits}f}'
