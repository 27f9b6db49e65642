"""Replay of other cameras: rectified images, and a camera_info that changed in mid-run."""

from pathlib import Path

from bagmaker import Message, new_listener, write_bag
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.phases.standing import RESUMING_FRAMES
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.servoing import camera
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

TRUE = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
OTHER = Camera(1280, 1024, 700.0, 700.0, 635.0, 512.0)
RAW = Camera(1280, 1024, 760.0, 760.0, 640.0, 500.0, (-0.2, 0.05, 0.0, 0.0))
AWAY = Pose.from_start(1.0, -3.5, 8.0)
PERIOD_NS = 90_909_091


def info(camera: Camera, stamp_ns: int, rectified: Camera | None = None):
    message = write.camera_info(camera, stamp_ns, 'camera')
    if rectified is not None:
        message.p = write.camera_info(rectified, 0, '').p
    return message


def recorded(bench, infos, **values) -> list[Message]:
    """Return all that a servo says and hears that is given one camera_info after the other."""
    listener, received = new_listener(bench.context)
    bench.add(listener)
    calibrate, send = bench.talk(CameraInfo, 'camera_info'), bench.talk(PointCloud2, 'tracks')
    node = bench.start(ServoNode, autostart=True, stale_timeout=60.0, max_latency=0.0, **values)
    world = PointWorld(PointSettings(), FixedRig(TRUE), seed=0)
    bench.settle()
    for number, message in enumerate(infos):
        stamp_ns = (number + 1) * PERIOD_NS
        message.header.stamp = write.stamp(stamp_ns)
        calibrate(message)
        bench.settle()
        send(write.features(world.observe(AWAY, number), stamp_ns, 'camera'))
        bench.until(lambda stamp_ns=stamp_ns: node._run.stamp_ns == stamp_ns, 'tracks to arrive')
        bench.settle()
    return received


def compared(path: Path, **overrides):
    with Bag(path) as bag:
        run = read_run(bag, assign_roles(bag, {}))
        steps = replay(bag, run, plan(bag, run, ReplayOverrides(**overrides))[0])
    return steps, compare(run, steps, 0.0)


def test_a_camera_that_changed_in_mid_run_holds_in_the_replay_as_well(
    bench, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(camera, 'DISTRUST_S', 1.5e-9 * PERIOD_NS)  # the first image is refused
    messages = recorded(bench, [info(TRUE, 0)] * 4 + [info(OTHER, 0)] * 4 + [info(TRUE, 0)] * 4)
    steps, comparison = compared(write_bag(tmp_path / 'bag', messages))
    assert comparison.equal
    phases = [step.phase.value for step in steps]
    held = 4 + RESUMING_FRAMES - 1
    assert phases[3 : 5 + held] == ['displacing', *['holding'] * held, 'displacing']


@pytest.mark.parametrize('known', [True, False])
def test_rectified_images_are_replayed_as_such(bench, tmp_path, known) -> None:
    messages = recorded(bench, [info(RAW, 0, TRUE)] * 4, rectified=True)
    if not known:
        messages = [item for item in messages if item[0] != '/servo_node/settings']
    path = write_bag(tmp_path / 'bag', messages)
    changes = {'servo': {'autostart': True}}
    assert compared(path, rectified=not known, changes=changes)[1].equal
    if not known:
        assert not compared(path, changes=changes)[1].equal


@pytest.mark.parametrize('known', [True, False])
def test_cropped_images_are_replayed_as_such(bench, tmp_path, known) -> None:
    crop = Camera(1280, 1024, 769.2, 769.2, 300.0, 512.0)
    messages = recorded(bench, [info(crop, 0)] * 4, cropped=True)
    if not known:
        messages = [item for item in messages if item[0] != '/servo_node/settings']
    path = write_bag(tmp_path / 'bag', messages)
    changes = {'servo': {'autostart': True}}
    assert compared(path, cropped=not known, changes=changes)[1].equal
    if not known:
        with pytest.raises(InputError, match='camera_info cannot be used: the principal point'):
            compared(path, changes=changes)
