"""What changes about a dock node in mid-life: its camera, its settings, its state, its end."""

from types import SimpleNamespace

from dock_rig import Rig
from docking_drives import CAMERA
from lifecycles import assert_gone_at_once, go
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo

pytest.importorskip('test_msgs', reason='pip install ros-jazzy-test-msgs==2.0.3')

from dock_requests import SERVED, served  # noqa: E402

from visual_servo_epipolar.core.geometry.motion import Pose  # noqa: E402
from visual_servo_epipolar.core.stamps import NOT_ADVANCING  # noqa: E402
from visual_servo_epipolar.messages import read, transforms, write  # noqa: E402
from visual_servo_epipolar.nodes import parameters  # noqa: E402
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount  # noqa: E402

LEVEL = CameraMount().R_world_camera(Pose(0.0, 0.0, 0.0))


def test_a_camera_that_cannot_be_used_any_more_is_waited_for(bench) -> None:
    rig = Rig(bench).drive()
    reports = len(rig.reports)
    rig.info(CameraInfo())
    bench.until(lambda: bench.logged('camera_info cannot be used'), 'what is wrong')
    rig.see()
    bench.settle()
    assert len(rig.reports) == reports
    rig.calibrate()
    rig.tell_odometry()
    bench.until(lambda: len(rig.reports) > reports, 'the tracks to be looked at')


def test_settings_of_docking_hold_from_the_next_event_on(bench) -> None:
    node = bench.start(served, **SERVED)
    changed = node.set_parameters([parameters.override('max_retries', 7)])
    assert all(result.successful for result in changed)
    assert node._server.settings.max_retries == 7


def test_tracks_that_wait_do_not_outlive_a_deactivation(bench) -> None:
    rig = Rig(bench)
    rig.see()  # and hear of no odometry
    bench.settle()
    assert len(rig.pending) == 1
    go(bench, rig.node, 'deactivate')
    assert not rig.pending


def test_a_reset_and_stamps_of_before_drop_tracks_that_wait(bench) -> None:
    rig = Rig(bench)
    rig.frame = 5
    rig.see()
    bench.settle()
    assert bench.call('dock_node/reset').success
    assert not rig.pending
    for rig.frame in (6, 1):
        rig.see()
        bench.settle()
    assert [read.stamp_ns(cloud.header) for cloud in rig.pending] == [rig.stamp_ns]


def test_tracks_that_are_not_of_the_camera_are_complained_of(bench) -> None:
    rig = Rig(bench)
    small = write.camera_info(CAMERA.__class__(64, 48, 40.0, 40.0, 32.0, 24.0), 0, 'camera')
    rig.info(small)
    bench.settle()
    rig.step()
    bench.until(lambda: bench.logged('64x48'), 'what is wrong with them')


def test_active_again_it_takes_stamps_as_they_come(bench) -> None:
    rig = Rig(bench).drive(2)
    go(bench, rig.node, 'deactivate', 'activate')
    rig.frame = 0  # a bag that is played again
    rig.drive(1)
    assert not bench.logged(NOT_ADVANCING)
    rig.frame = 0
    rig.see()
    bench.until(lambda: bench.logged(NOT_ADVANCING), 'what is wrong with a stamp of before')


def test_a_cleanup_forgets_the_mount_of_tf_static(bench) -> None:
    rig = Rig(bench, mount_from_tf=True)
    edge = transforms.mount_transform('base_link', 'camera', LEVEL, np.array([0.1, 0.0, 0.6]))
    rig.node._mount.receive(SimpleNamespace(transforms=[edge]))
    rig.drive(1)
    assert rig.settings.camera_forward == pytest.approx(0.1)
    go(bench, rig.node, 'deactivate', 'cleanup')
    assert rig.settings.camera_forward == 0.0


def test_a_dock_node_that_is_destroyed_is_gone_at_once(bench) -> None:
    assert_gone_at_once(bench, bench.start(served, **SERVED))
