"""Node and memory are one: what is taught and repeated over messages is so to the last bit."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from route_rig import RouteRig

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.routes.run import RouteStep
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.messages.route_folder import read_route, write_route
from visual_servo_epipolar.simulation.bases import PioneerSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.routes import (
    driven_in,
    repeat,
    rounded,
    route_scenario,
    Taught,
    teach,
)
from visual_servo_epipolar.simulation.scenario import Scenario

SCENARIO = route_scenario(Scenario(base=PioneerSettings(wheel_ratio=1.01)), 1).with_servo(
    {'law': 'smooth', 'latency': 0.0}
)
IMAGES = 20  # of the short comparison, in which it finds itself and follows


WAY = rounded(((3.0, -3.9), (3.0, -2.7)))
shown: list[tuple[Image, int, Pose]] = []  # images of the drive, stamps, odometry


@pytest.fixture(scope='module')
def taught() -> Taught:
    return teach(SCENARIO, WAY, watch=lambda *what: shown.append(what))


@pytest.mark.long
def test_a_way_that_is_recorded_is_the_one_of_memory(bench, tmp_path: Path, taught) -> None:
    rig = RouteRig(bench, tmp_path / 'hall', SCENARIO.camera.nominal_camera)
    rig.see(shown[0][0], 0)
    assert rig.call('start_recording')[0]
    for image, stamp_ns, odometry in shown:
        rig.see(image, stamp_ns, odometry)
        rig.bench.until(lambda: rig.node._recording.behind < 20, 'images to be learnt from')
    rig.bench.settle()
    success, text = rig.call('stop_recording')
    assert success, text
    write_route(taught.route, tmp_path / 'memory')
    recorded, expected = read_route(tmp_path / 'hall'), read_route(tmp_path / 'memory')
    assert recorded.length == expected.length
    for one, other in zip(recorded.views, expected.views, strict=True):
        assert np.array_equal(one.image, other.image)
        # Headings of odometry are quaternions on their way: their last bits are others.
        depths = one.structure.inverse_depth, other.structure.inverse_depth
        np.testing.assert_allclose(*depths, rtol=1e-6)
        np.testing.assert_allclose(one.path.poses, other.path.poses, atol=1e-8)


def test_a_way_that_is_repeated_is_the_one_of_memory(bench, tmp_path: Path, taught) -> None:
    compare(bench, tmp_path, taught, IMAGES)


@pytest.mark.long
def test_a_whole_way_is_the_one_of_memory_up_to_its_station(bench, tmp_path, taught) -> None:
    compare(bench, tmp_path, taught, 10_000)


def compare(bench, folder: Path, taught: Taught, images: int) -> None:
    """Repeat a way by a node and in memory, up to so many ``images``, and compare commands."""
    write_route(taught.route, folder / 'hall')
    taught = Taught(read_route(folder / 'hall'), taught.way, taught.stations)
    scenario, start = SCENARIO.seeded(5), taught.stations[0]
    expected: list[tuple[Twist, str]] = []
    poses: list[Pose] = []

    def watch(image, pose: Pose, step: RouteStep) -> None:
        if len(expected) == images:
            raise StopIteration
        expected.append((step.twist, step.phase))
        poses.append(pose)

    try:
        repeat(scenario, taught, FollowSettings(), start=start, watch=watch)
    except StopIteration:
        pass
    values = {**asdict(scenario.servo), 'watchdog': False}
    rig = RouteRig(bench, folder / 'hall', scenario.camera.nominal_camera, **values)
    driven, simulator = driven_in(scenario, start, 6), CameraSimulator(scenario.camera)
    assert rig.call('repeat')[0]
    for k, (twist, phase) in enumerate(expected):
        assert driven.pose == poses[k], k
        told = rig.answered(simulator.capture(driven.exposed_at, k), driven.now_ns)
        assert (told, rig.node.phase) == (twist, phase), k
        driven.drive(Command(told))
    assert len(expected) == images or expected[-1][1] == 'arrived'
