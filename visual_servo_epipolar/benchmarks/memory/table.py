"""
Table of the memory beside its bound and its peers: python -m this module [trials].

Errors are those of one view 0-20 mm before the goal, after 14 views along a spiral and a line.
"""

from collections.abc import Iterator
import math
import sys
import time

import numpy as np

from visual_servo_epipolar.benchmarks.memory.bound import bound_of_two_views
from visual_servo_epipolar.benchmarks.memory.peers import by_opencv, by_two_views
from visual_servo_epipolar.benchmarks.memory.study import (
    PIONEER,
    remembered,
    SMALL,
    StudySettings,
    trial,
    two_views,
)
from visual_servo_epipolar.benchmarks.memory.trials import Errors, errors_of, PLANE
from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Prior
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.core.memory.sightings import MemorySettings
from visual_servo_epipolar.core.memory.view_memory import ViewMemory

TRIALS = 30
UNITS = np.array([1e3, 1e3, math.degrees(1.0)])
CAMERAS = {'640x480, f 600': SMALL, '1280x1024, f 769': PIONEER}
HEAD = f'{"":<44}{"lateral":>9}{"along":>9}{"heading":>10}{"normalised":>12}'


def rows_of(settings: StudySettings, trials: int) -> Iterator[str]:
    """Yield the rows of one scene: memory and bound, then peers."""
    errors = errors_of(settings, range(trials))
    yield _row('memory', errors.rms, f'{errors.normalised:12.2f}')
    yield _row('bound of all views', errors.bound)
    yield _row('memory over bound', errors.rms / errors.bound, units=np.ones(3))
    yield _row('OpenCV solvePnP on the same structure', opencv_errors(settings, trials))
    yield _row('bound of two views, told the distance', two_views_bound(settings, trials))
    yield _row('soft_planar, told the distance', two_views_errors(settings, trials))
    yield wrong_matches(errors)


def wrong_matches(errors: Errors) -> str:
    """Return in words which wrong matches were found."""
    return (
        f'{"wrong matches":<44}{errors.found} of {errors.wrong} dropped, and {errors.innocent} '
        f'others; trials without a pose: {errors.silent}'
    )


def opencv_errors(settings: StudySettings, trials: int) -> FloatArray:
    """Return the root mean square errors of OpenCV on what the memory knows, (3,)."""
    poses = []
    for drive in (trial(settings, seed) for seed in range(trials)):
        geometry, k = remembered(drive).geometry, len(drive.views) - 1
        if geometry is not None:
            poses.append(np.array(by_opencv(drive, k, geometry)) - drive.views[k, PLANE])
    return np.asarray(np.sqrt(np.nanmean(np.square(poses), axis=0)))


def two_views_errors(settings: StudySettings, trials: int) -> FloatArray:
    """Return the root mean square errors of photograph and last view alone, (3,)."""
    drives = [trial(settings, seed) for seed in range(trials)]
    errors = [np.array(by_two_views(it, -1)) - it.views[-1, PLANE] for it in drives]
    return np.asarray(np.sqrt(np.nanmean(np.square(errors), axis=0)))


def two_views_bound(settings: StudySettings, trials: int) -> FloatArray:
    """Return the least deviations that photograph and last view alone allow, (3,)."""
    drives = (trial(settings, seed) for seed in range(trials))
    variances = [np.diag(bound_of_two_views(drive))[PLANE] for drive in drives]
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))


def _row(name: str, values: FloatArray, more: str = '', units: FloatArray = UNITS) -> str:
    lateral, along, heading = (values * units).tolist()
    return f'{name:<44}{lateral:9.2f}{along:9.2f}{heading:10.4f}{more}'


def times_of(settings: StudySettings, rounds: int = 60) -> Iterator[str]:
    """Yield medians of the processor's time [ms], by turns with two views from the last ones."""
    drive = trial(settings, 3)
    k = len(drive.views) - 1
    sightings, told = drive.sightings(k), two_views(drive, k - 2)
    memory = remembered(drive)
    while memory.geometry is not None and not memory.geometry.converged:
        memory, _ = memory.after(drive.sightings(k - 1))
    prior = Prior(told.attitude or drive.mount, told.bearings[0], mount=drive.mount)
    before = drive.sightings(k - 2)
    rng = np.random.default_rng(0)

    def two() -> None:
        soft_planar(before.current, before.desired, noise=before.noise, prior=prior, rng=rng)

    still, moved = (_with_spread(memory, spread) for spread in (9.0, 1e-6))
    calls = {
        'a view': lambda: still.after(sightings),
        'a view that becomes a keyframe': lambda: moved.after(sightings),
        'two views, from the last bearings': two,
    }
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.process_time()
            call()
            times[name].append(1e3 * (time.process_time() - start))
    floor = float(np.median(times['two views, from the last bearings']))
    for name, values in times.items():
        median = float(np.median(values))
        yield f'{name:<44}{median:9.2f} ms{median / floor:9.2f} of two views'


def _with_spread(memory: ViewMemory, spread: float) -> ViewMemory:
    geometry = memory.geometry
    return ViewMemory(
        memory.mount,
        MemorySettings(spread=spread),
        memory.window,
        geometry,
        memory.starts,
        memory.place,
        memory.pose,
    )


def main() -> None:
    """Print the table."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else TRIALS
    for camera, model in CAMERAS.items():
        for noise in (0.2, 0.03):
            for wall in (False, True):
                scene = 'one wall at 5 m, 4 % relief' if wall else 'room, 3-8 m deep'
                print(f'\n{scene}, {noise} px, {camera}, {trials} trials: rms [mm, mm, deg]')
                print(HEAD)
                settings = StudySettings(wall=wall, noise=noise, camera=model)
                for row in rows_of(settings, trials):
                    print(row, flush=True)
    print()
    for row in times_of(StudySettings()):
        print(row)


if __name__ == '__main__':
    main()
