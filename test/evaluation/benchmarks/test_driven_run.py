"""Images of a run that the servo has driven: shown again, they lead to the same commands."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.evaluation.benchmarks import latency
from visual_servo_epipolar.evaluation.benchmarks.latency import (
    are_same,
    driven,
    DrivenRun,
    in_memory,
    steps,
)
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

CAMERA = CameraSettings(
    width=320,
    height=240,
    focal_length=192.0,
    principal_u=159.5,
    principal_v=119.5,
    frame_rate=20.0,
)
SECONDS = 3.0


@pytest.fixture(scope='module')
def run(tmp_path_factory) -> DrivenRun:
    return driven(CAMERA, SECONDS, tmp_path_factory.mktemp('run'))


def test_tracker_and_servo_command_what_they_did_while_they_drove(run) -> None:
    assert len(run.images) == len(run.twists) == SECONDS * CAMERA.frame_rate
    assert [twist for _, twist in steps(run)] == list(run.twists)


def test_the_robot_in_the_images_goes_where_the_servo_sends_it(run) -> None:
    assert run.twists[-1] != STANDSTILL
    noise = 5.0 * CAMERA.noise
    moved = np.abs(run.images[0].astype(float) - run.images[-1]) > noise
    assert moved.mean() > 0.05


def test_twists_differ_where_the_images_are_of_another_way(run) -> None:
    standing = replace(run, images=[run.images[0]] * len(run.images))
    twists = [twist for _, twist in steps(standing)]
    same = [are_same(*pair) for pair in zip(twists, run.twists, strict=True)]
    assert sum(same) < 0.5 * len(same)


def test_times_in_memory_are_medians_of_both(run) -> None:
    times = in_memory(run)
    assert set(times) == {'tracker_ms', 'servo_ms'} and min(times.values()) > 0.0


def test_no_image_is_from_after_the_end_of_a_run(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(latency, 'START', (0.0, 0.0, 0.0))
    arrived = driven(CAMERA, 20.0, tmp_path)
    assert 0 < len(arrived.images) == len(arrived.twists) < 20.0 * CAMERA.frame_rate


def test_twists_are_the_same_within_a_millimetre_and_half_a_degree_a_second() -> None:
    twist = Twist(0.2, 0.1)
    assert are_same(twist, Twist(0.2009, 0.1 + math.radians(0.4)))
    assert not are_same(twist, Twist(0.2011, 0.1))
    assert not are_same(twist, Twist(0.2, 0.1 + math.radians(0.6)))


class Wire:
    """A loop over no wire: notes what is shown and called, and answers as the run was driven."""

    def __init__(self, twists: list[Twist]) -> None:
        self.processes = dict.fromkeys(('tracker_node', 'servo_node'))
        self.events: list[object] = []
        self._twists = twists

    def call(self, service: str) -> None:
        self.events.append(service)

    def show_each(self, images: list, rate: float) -> SimpleNamespace:
        self.events += list(images)
        return SimpleNamespace(numbers=list(range(len(images))), twists=self._twists)


def test_each_turn_begins_at_the_first_image_with_a_servo_that_begins_anew(run) -> None:
    wire = Wire([*run.twists[:9], Twist(1.0, 0.0)])
    two = latency.TwoNodes(wire, run)
    for _ in range(2):
        wire.events.clear()
        two.begin()
        assert wire.events[:2] == ['servo_node/stop', 'tracker_node/redetect']
        assert wire.events[-2:] == ['servo_node/reset', 'servo_node/start']
        wire.events.clear()
        two.turn(10 / run.rate)
        assert all(
            shown is image for shown, image in zip(wire.events, run.images[:10], strict=True)
        )
    assert two.as_driven == 2 * 9
