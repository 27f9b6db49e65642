"""The rendering benchmark: what it times is what the camera does; its table can be printed."""

from collections.abc import Iterator
from dataclasses import replace
import json
from typing import Any

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.benchmarks.speed import rendering
from visual_servo_epipolar.evaluation.benchmarks.speed.rendering import STAGES
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator

CAMERA = replace(
    rendering.SMALL,
    width=160,
    height=120,
    focal_length=96.0,
    principal_u=79.5,
    principal_v=59.5,
    scene='wall',
)


@pytest.fixture
def threads() -> Iterator[int]:
    count = cv2.getNumThreads()
    yield count
    cv2.setNumThreads(count)


def ticking(seconds: float) -> Any:
    """Return a clock that is ``seconds`` later whenever it is read."""
    now = 0.0

    def read() -> float:
        nonlocal now
        now += seconds
        return now

    return read


def test_figures_are_of_the_clock_and_the_table_takes_them(
    monkeypatch: pytest.MonkeyPatch, threads: int
) -> None:
    monkeypatch.setattr(rendering, 'process_time', ticking(0.002))
    plan = rendering.RenderingPlan(cameras=(CAMERA,), images=3)
    document = json.loads(json.dumps(rendering.measure(plan, 0, lambda text: None)))
    (row,) = document['cameras']
    assert row['size'] == [160, 120]
    assert row['ratio']['median'] == pytest.approx(1.0)
    assert {name: row['ms'][name]['median'] for name in ('image', 'remap', 'polygons')} == {
        name: pytest.approx(2.0) for name in ('image', 'remap', 'polygons')
    }
    text = rendering.table(document)
    assert all(stage in text for stage in STAGES)
    assert '160x120' in text
    assert cv2.getNumThreads() == threads


def test_threads_are_given_back_when_it_fails(threads: int) -> None:
    def fail(text: str) -> None:
        assert cv2.getNumThreads() == 1
        raise RuntimeError(text)

    cv2.setNumThreads(2)
    with pytest.raises(RuntimeError):
        rendering.measure(rendering.QUICK, 0, fail)
    assert cv2.getNumThreads() == 2


def test_the_stages_draw_what_the_camera_sees() -> None:
    simulator = CameraSimulator(replace(CAMERA, noise=0.0))
    drawn: list[np.ndarray] = []
    mix_edges = rendering.mix_edges

    def keep(image: np.ndarray, *given: Any) -> None:
        mix_edges(image, *given)
        drawn.append(image)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, 'mix_edges', keep)
        rendering.stage_times(simulator, DESIRED_POSE, 0)
    np.testing.assert_array_equal(drawn[0], simulator.capture(DESIRED_POSE, 0))


def test_the_maps_turn_an_image_about_its_middle() -> None:
    image = np.zeros((100, 200), np.uint8)
    image[45:56, 150:161] = 255  # 55 right of the middle
    half = cv2.remap(image, *rendering.turning_maps((200, 100), np.pi), cv2.INTER_LINEAR)
    assert half[45:56, 40:50].mean() > 250
    assert half[:, 60:].max() == 0
