"""The benchmark of the memory: its peers are right without noise, and it beats them with some."""

import json
import math

import numpy as np
import pytest

from visual_servo_epipolar.evaluation.benchmarks.memory import benchmark
from visual_servo_epipolar.evaluation.benchmarks.memory.peers import by_trifocal, tensor_of
from visual_servo_epipolar.evaluation.benchmarks.memory.study import StudySettings, trial


@pytest.mark.parametrize('seed', range(4))
def test_the_trifocal_tensor_is_exact_without_noise(seed: int) -> None:
    drive = trial(StudySettings(noise=1e-9, wrong=0.0, jitter=1e-9), seed)
    last = len(drive.views) - 1
    assert by_trifocal(drive, last) == pytest.approx(drive.views[last, :3], abs=1e-5)


def test_bearings_of_one_point_meet_in_the_tensor() -> None:
    poses = np.array([-1.2, 0.3, 0.1, -0.6, -0.2])
    places = [(0.0, 0.0, 0.0), (math.cos(-1.2), math.sin(-1.2), 0.3), (0.1, -0.6, -0.2)]
    total = tensor_of(poses)
    for x, y, heading in places:
        c, s = math.cos(heading), math.sin(heading)
        right, ahead = np.array([[c, s], [-s, c]]) @ np.array([0.7 - x, 4.0 - y])
        bearing = math.atan2(right, ahead)
        total = np.tensordot(total, [math.cos(bearing), -math.sin(bearing)], axes=(0, 0))
    assert total == pytest.approx(0.0, abs=1e-12)


def test_the_memory_is_nearer_than_what_three_views_say() -> None:
    document = json.loads(json.dumps(benchmark.run(seed=0, quick=True, say=lambda _: None)))
    rows = {row['method']: row for row in document['scenes'][0]['rows']}
    trifocal = rows['1-D trifocal tensor, told the distance']
    assert rows[benchmark.MEMORY]['lateral_mm'] < trifocal['lateral_mm']
    text = benchmark.table(document)
    assert 'room, 3-8 m deep, 0.2 px, 640x480, f 600, 2 trials' in text
    assert 'a view that becomes a keyframe' in text
    assert all(value > 0.0 for value in benchmark.figures(document).values())
