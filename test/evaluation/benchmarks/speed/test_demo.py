"""The demo against real time: the real command, its real time."""

import json

import numpy as np
import pytest

pytest.importorskip('rclpy')

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.evaluation.benchmarks.speed import demo as loop


@pytest.mark.long
def test_the_demo_is_timed(monkeypatch) -> None:
    small = {'neither': ('--no-video', '--bag', 'none', '--scenario', 'small')}
    monkeypatch.setattr(loop, 'VARIANTS', small)
    monkeypatch.setattr(loop, 'QUICK_LONG', ('0', '-0.5', '0'))
    document = loop.run(seed=0, quick=True, say=lambda _: None)
    (row,) = document['rows']
    assert row['simulated_s'] > 0.0 and row['processor_s'] > 0.0
    assert np.isfinite(row['driving_real_time'])
    assert row['real_time'] == row['simulated_s'] / row['wall_s']
    assert 'neither' in loop.table(json.loads(json.dumps(document)))
    assert loop.figures(document) == {
        'demo with neither, wall over simulated time': 1.0 / row['real_time']
    }


def test_a_demo_without_result_is_an_error(monkeypatch) -> None:
    monkeypatch.setattr(loop, 'VARIANTS', {'nonsense': ('--law', 'nonsense')})
    with pytest.raises(VisualServoError, match='the demo gave no result: .*nonsense'):
        loop.run(seed=0, quick=True, say=lambda _: None)
