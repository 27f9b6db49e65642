"""The servo takes the mount of its camera from /tf_static, before a run, unless it is set."""

from dataclasses import replace
import math

from lifecycles import go
import numpy as np
import pytest
from servo_rig import CAMERA, IN_VIEW, Rig
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.messages import settings_text, transforms, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.simulation.rigs import CameraMount

BASE = Pose(0.0, 0.0, 0.0)
MOUNT = CameraMount(0.6, 0.2, 0.3, -0.1, 0.05, 0.1)
UPRIGHT = np.eye(3)


def mounted(parent='base_link', child='camera_optical_frame', mount=MOUNT):
    place = mount.R_world_camera(BASE), mount.centre(BASE)
    return transforms.mount_transform(parent, child, *place)


class Mounted(Rig):
    """A servo node that is told of mounts and sees from there."""

    def __init__(self, bench, **values) -> None:
        super().__init__(bench, calibrated=False, **{'mount_from_tf': True, **values})

    def look(self, frame='camera_optical_frame') -> None:
        """Send tracks with their camera_info, and wait until the node has taken them in."""
        self.hear(write.camera_info(CAMERA, self.stamp_ns, frame))
        self.show(IN_VIEW, frame)


@pytest.fixture
def settings(bench):
    """Return what tells the settings in force, as the servo announces them."""
    heard = bench.listen(String, 'servo_node/settings', qos.LATCHED)

    def now() -> dict:
        bench.settle()
        return settings_text.from_text(heard[-1].data).values

    return now


def test_the_mount_is_taken_with_the_first_tracks_and_announced(bench, settings) -> None:
    heard = bench.listen(String, 'servo_node/settings', qos.LATCHED)
    rig = Mounted(bench)
    bench.until(lambda: len(heard) == 1, 'the settings')
    rig.told(mounted())
    rig.look()
    assert settings()['camera_tilt'] == pytest.approx(0.3)
    assert settings()['camera_yaw'] == pytest.approx(0.1)
    # The camera is level: the transform is wrong, and that is found out.
    assert rig.run.state.view.memory.attitude.tilt == pytest.approx(0.0, abs=0.03)
    line = '/tf_static: camera_optical_frame sits at tilt 17.2 deg, roll -5.7 deg'
    bench.until(lambda: bool(bench.logged(line)), 'the log')
    bench.until(lambda: len(heard) == 2, 'the settings, announced anew')
    announced = settings_text.from_text(heard[-1].data)
    assert announced.values['camera_tilt'] == pytest.approx(0.3)
    assert announced.after_stamp_ns is None  # they hold for the first tracks as well


def test_a_chain_of_frames_is_followed(bench, settings) -> None:
    rig = Mounted(bench)
    rig.told(transforms.mount_transform('mast', 'camera_link', UPRIGHT, np.array([0.1, 0.0, 0.3])))
    rig.told(transforms.mount_transform('base_link', 'mast', UPRIGHT, np.array([0.1, 0.05, 0.2])))
    rig.told(mounted('camera_link', mount=CameraMount(0.0, 0.0, 0.3, -0.1, 0.0, 0.1)))
    rig.look()
    assert settings()['camera_roll'] == pytest.approx(-0.1)
    assert settings()['camera_forward'] == pytest.approx(0.2)
    assert settings()['camera_left'] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ('edges', 'has'),
    [
        ([mounted(child='lidar')], 'it has lidar'),
        ([mounted('mast')], 'it has camera_optical_frame'),
        ([], 'it has nothing'),
    ],
)
def test_a_camera_that_it_does_not_lead_to_is_logged_once(bench, monkeypatch, edges, has) -> None:
    monkeypatch.setattr(transforms, 'tf_message_class', lambda: String)  # as if it were installed
    rig = Mounted(bench)
    rig.told(*edges)
    for _ in range(3):
        rig.look()
        assert bench.call('servo_node/reset').success
    text = "/tf_static does not lead from base_link to 'camera_optical_frame'"
    bench.until(lambda: bool(bench.logged(text)), 'the warning')
    (said,) = bench.logged(text)
    assert has in said


@pytest.mark.parametrize(
    ('values', 'edges'),
    [
        ({'camera_yaw': 0.02}, [mounted()]),
        ({}, []),
        ({}, [mounted('mast')]),
        ({}, [mounted('a', 'b'), mounted('b', 'camera_optical_frame'), mounted('b', 'a')]),
    ],
)
def test_otherwise_the_settings_stay(bench, settings, values, edges) -> None:
    rig = Mounted(bench, **values)
    before = settings()
    rig.told(*edges)
    rig.look()
    assert settings() == before


def test_without_tf2_msgs_it_says_so(bench, monkeypatch) -> None:
    monkeypatch.setattr(transforms, 'tf_message_class', lambda: None)
    rig = Mounted(bench)
    text = 'tf2_msgs cannot be imported, mount_from_tf has no effect; install ros-jazzy-tf2-msgs'
    bench.until(lambda: bool(bench.logged(text)), 'the warning')
    rig.look()  # by what it cannot hear no frame_id is found wrong
    assert not bench.logged('/tf_static does not lead')


def test_unless_it_is_wanted_there_is_no_subscription(bench) -> None:
    topics = {item.topic_name for item in bench.start(ServoNode).subscriptions}
    assert topics.isdisjoint({'/tf_static', '/odom'})


def test_what_comes_in_mid_run_waits_for_the_next(bench, settings) -> None:
    rig = Mounted(bench)
    rig.look()
    rig.told(mounted())
    rig.look()
    assert settings()['camera_tilt'] == 0.0
    assert bench.call('servo_node/stop').success
    assert bench.call('servo_node/start').success
    rig.look()
    assert settings()['camera_tilt'] == pytest.approx(0.3)


def test_a_cleanup_forgets_the_mount(bench, settings) -> None:
    rig = Mounted(bench)
    rig.told(mounted())
    rig.look()
    go(bench, rig.node, 'deactivate', 'cleanup')
    go(bench, rig.node, 'configure', 'activate')
    rig.told(mounted(mount=replace(MOUNT, tilt=0.2)))
    rig.look()
    assert settings()['camera_tilt'] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ('mount', 'why'),
    [
        (UPRIGHT, 'an optical frame looks ahead'),
        (replace(MOUNT, yaw=math.pi).R_world_camera(BASE), 'camera_yaw must lie in'),
    ],
)
def test_by_a_mount_that_cannot_be_used_no_robot_drives(bench, settings, mount, why) -> None:
    rig = Mounted(bench)
    before = settings()
    rig.told(transforms.mount_transform('base_link', 'camera', mount, np.zeros(3)))
    rig.look(frame='camera')
    assert settings() == before
    bench.until(lambda: bool(bench.logged(why)), 'the warning')
    assert rig.phase == 'waiting' and not rig.commands
    rig.run.report()
    assert 'the mount of camera in /tf_static cannot be used' in rig.reason
    # Another description of the robot is one that it can drive by.
    rig.told(mounted(child='camera'))
    rig.look(frame='camera')
    assert rig.phase != 'waiting'


def test_a_broken_transform_is_logged_and_left_out(bench, settings) -> None:
    rig = Mounted(bench)
    broken = mounted()
    broken.transform.rotation.w = math.nan
    rig.told(broken)
    rig.look()
    assert settings()['camera_tilt'] == 0.0
    line = 'the transform to camera_optical_frame must be finite'
    bench.until(lambda: bool(bench.logged(line)), 'the warning')


def test_with_the_real_tf2_msgs_it_is_heard(bench, settings) -> None:
    kind = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs is not installed').TFMessage
    bench.talk(kind, '/tf_static', qos.STATIC_TRANSFORMS)(kind(transforms=[mounted()]))
    rig = Mounted(bench)
    bench.settle()
    rig.look()
    assert settings()['camera_tilt'] == pytest.approx(0.3)
