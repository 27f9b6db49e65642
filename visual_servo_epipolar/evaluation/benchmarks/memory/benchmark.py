"""
Memory of views beside its bound and its peers, and what it costs.

Errors are those of one view 0-20 mm before the goal, after 14 views along a spiral and a line.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
import math
import time
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Prior
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.core.mapping.feature_observations import MapSettings
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.evaluation.benchmarks.memory.bound import (
    bound_of_two_views,
    errors_of,
    PLANE,
    TrialErrors,
)
from visual_servo_epipolar.evaluation.benchmarks.memory.peers import (
    by_opencv,
    by_trifocal,
    by_two_views,
)
from visual_servo_epipolar.evaluation.benchmarks.memory.study import (
    map_after_drive,
    PIONEER,
    SMALL,
    StudySettings,
    StudyTrial,
    trial,
    two_views,
)
from visual_servo_epipolar.evaluation.tables import aligned

TRIALS, QUICK_TRIALS = 30, 2
ROUNDS, QUICK_ROUNDS = 60, 3
UNITS = np.array([1e3, 1e3, math.degrees(1.0)])
COLUMNS = ('lateral_mm', 'longitudinal_mm', 'heading_deg')
CAMERAS = {'640x480, f 600': SMALL, '1280x1024, f 769': PIONEER}
ROOM, WALL = 'room, 3-8 m deep', 'one wall at 5 m, 4 % relief'
MEMORY, BOUND = 'memory', 'bound of all views'
TWO_VIEWS = 'two views, from the last bearings'


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document: root mean square errors by scene and method, and times."""
    trials = QUICK_TRIALS if quick else TRIALS
    scenes = []
    for camera, noise, wall in _cells(quick):
        settings = StudySettings(wall=wall, noise=noise, camera=CAMERAS[camera])
        scene = {'scene': WALL if wall else ROOM, 'noise_px': noise, 'camera': camera}
        say(f'memory: {scene["scene"]}, {noise} px, {camera} ...')
        scenes.append(scene | _scene(settings, range(seed, seed + trials)))
    say('memory: times ...')
    rounds = QUICK_ROUNDS if quick else ROUNDS
    return {'trials': trials, 'scenes': scenes, 'times_ms': times_of(StudySettings(), rounds)}


def _cells(quick: bool) -> list[tuple[str, float, bool]]:
    cells = [(it, noise, wall) for it in CAMERAS for noise in (0.2, 0.03) for wall in (0, 1)]
    return [(camera, noise, bool(wall)) for camera, noise, wall in (cells[:1] if quick else cells)]


def _scene(settings: StudySettings, seeds: range) -> dict[str, Any]:
    """Return the errors of one scene: memory and bound, then peers."""
    errors = errors_of(settings, seeds)
    drives = [trial(settings, seed) for seed in seeds]
    methods = {
        MEMORY: errors.rms,
        BOUND: errors.bound,
        'OpenCV solvePnP on the same structure': opencv_errors(drives),
        '1-D trifocal tensor, told the distance': trifocal_errors(drives),
        'bound of two views, told the distance': two_views_bound(drives),
        'soft_planar, told the distance': two_views_errors(drives),
    }
    rows = [
        {'method': name, **dict(zip(COLUMNS, (UNITS * values).tolist(), strict=True))}
        for name, values in methods.items()
    ]
    return {'rows': rows, 'normalised': errors.normalised_error, 'wrong_matches': _found(errors)}


def _found(errors: TrialErrors) -> dict[str, int]:
    """Return which wrong matches were found."""
    return {
        'dropped': errors.found,
        'of': errors.wrong,
        'others_dropped': errors.innocent,
        'without_a_pose': errors.silent,
    }


def _rms(errors: list[FloatArray]) -> FloatArray:
    return np.asarray(np.sqrt(np.nanmean(np.square(errors), axis=0)))


def opencv_errors(drives: list[StudyTrial]) -> FloatArray:
    """Return the root mean square errors of OpenCV on what the memory knows, (3,)."""
    poses = []
    for drive in drives:
        geometry, k = map_after_drive(drive).geometry, len(drive.views) - 1
        if geometry is not None:
            poses.append(np.array(by_opencv(drive, k, geometry)) - drive.views[k, PLANE])
    return _rms(poses)


def trifocal_errors(drives: list[StudyTrial]) -> FloatArray:
    """Return the root mean square errors of photograph, first and last view, (3,)."""
    return _rms([by_trifocal(it, len(it.views) - 1) - it.views[-1, PLANE] for it in drives])


def two_views_errors(drives: list[StudyTrial]) -> FloatArray:
    """Return the root mean square errors of photograph and last view alone, (3,)."""
    return _rms([np.array(by_two_views(it, -1)) - it.views[-1, PLANE] for it in drives])


def two_views_bound(drives: list[StudyTrial]) -> FloatArray:
    """Return the least deviations that photograph and last view alone allow, (3,)."""
    variances = [np.diag(bound_of_two_views(drive))[PLANE] for drive in drives]
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))


def times_of(settings: StudySettings, rounds: int) -> dict[str, dict[str, float]]:
    """Return the processor's time [ms], by turns with two views from the last bearings."""
    drive = trial(settings, 3)
    k = len(drive.views) - 1
    observations, told = drive.observations(k), two_views(drive, k - 2)
    memory = map_after_drive(drive)
    while memory.geometry is not None and not memory.geometry.converged:
        memory = memory.after(drive.observations(k - 1))[0].update_map()
    prior = Prior(told.attitude or drive.mount, told.bearings[0], mount=drive.mount)
    before = drive.observations(k - 2)
    rng = np.random.default_rng(0)

    def two() -> None:
        soft_planar(before.current, before.desired, noise=before.noise, prior=prior, rng=rng)

    still, moved = (_with_spacing(memory, keyframe_spacing) for keyframe_spacing in (9.0, 1e-6))
    calls: dict[str, Callable[[], Any]] = {
        'a view': lambda: still.after(observations)[0].update_map(),
        'a view that becomes a keyframe': lambda: moved.after(observations)[0].update_map(),
        TWO_VIEWS: two,
    }
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.process_time()
            call()
            times[name].append(1e3 * (time.process_time() - start))
    return {
        name: {'median': float(np.median(each)), 'p99': float(np.percentile(each, 99.0))}
        for name, each in times.items()
    }


def _with_spacing(memory: KeyframeMap, keyframe_spacing: float) -> KeyframeMap:
    return replace(memory, settings=MapSettings(keyframe_spacing=keyframe_spacing))


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    floor = document['times_ms'][TWO_VIEWS]['median']
    times = {
        f'{name}, over two views': each['median'] / floor
        for name, each in document['times_ms'].items()
        if name != TWO_VIEWS
    }
    lateral = {
        f'{scene["scene"]}, {scene["noise_px"]} px, {scene["camera"]}: lateral over bound': (
            scene['rows'][0]['lateral_mm'] / scene['rows'][1]['lateral_mm']
        )
        for scene in document['scenes']
    }
    return {**lateral, **times}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text."""
    lines: list[str] = []
    for scene in document['scenes']:
        matches = scene['wrong_matches']
        rows = ([it['method'], *(f'{it[name]:.4f}' for name in COLUMNS)] for it in scene['rows'])
        lines += [
            f'{scene["scene"]}, {scene["noise_px"]} px, {scene["camera"]}, '
            f'{document["trials"]} trials, root mean square',
            *aligned('method | lateral mm | along mm | heading deg', rows),
            f'errors are {scene["normalised"]:.2f} of what was told; wrong matches: '
            f'{matches["dropped"]} of {matches["of"]} dropped, {matches["others_dropped"]} others',
            '',
        ]
    times = (
        [name, f'{each["median"]:.2f}', f'{each["p99"]:.2f}']
        for name, each in document['times_ms'].items()
    )
    return '\n'.join([*lines, *aligned('processor time | median ms | p99 ms', times)])
