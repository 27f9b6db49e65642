"""The servo takes the mount of its camera from /tf_static, before a run, where nobody told it."""

from dataclasses import replace
import math
from types import SimpleNamespace

from geometry_msgs.msg import Twist
from lifecycles import go
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.messages import settings_text, transforms, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

CAMERA = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
WORLD = PointWorld(PointSettings(), FixedRig(CAMERA), seed=0)
AWAY, BASE = Pose.from_start(1.0, -3.5, 8.0), Pose(0.0, 0.0, 0.0)
MOUNT = CameraMount(0.6, 0.2, 0.3, -0.1, 0.05, 0.1)
UPRIGHT = np.eye(3)
STAMP_NS = 7_000_000_003


def mounted(parent='base_link', child='camera_optical_frame', mount=MOUNT):
    return transforms.mount_transform(
        parent, child, mount.R_world_camera(BASE), mount.centre(BASE)
    )


def told(node, *messages) -> None:
    """Hand it what tf2_msgs/TFMessage would bring, which the wheels of ROS 2 are without."""
    node._camera.static_mount.receive(SimpleNamespace(transforms=list(messages)))


def see(bench, node, stamp_ns=STAMP_NS, frame='camera_optical_frame') -> None:
    """Send tracks with their camera_info, and wait until the node has taken them in."""
    bench.talk(CameraInfo, 'camera_info')(write.camera_info(CAMERA, stamp_ns, frame))
    bench.until(lambda: node._camera.model is not None, 'camera_info to arrive')
    bench.talk(PointCloud2, 'tracks')(write.features(WORLD.observe(AWAY, 0), stamp_ns, frame))
    bench.until(lambda: node._run.stamp_ns == stamp_ns, 'tracks to arrive')
    bench.settle()


def started(bench, **values) -> ServoNode:
    values = {
        'mount_from_tf': True,
        'autostart': True,
        'stale_timeout': 60.0,
        'max_latency': 0.0,
        **values,
    }
    return bench.start(ServoNode, **values)


def test_the_mount_is_taken_with_the_first_tracks_and_announced(bench) -> None:
    heard = bench.listen(String, 'servo_node/settings', qos.LATCHED)
    node = started(bench)
    bench.until(lambda: len(heard) == 1, 'the settings')
    told(node, mounted())
    see(bench, node)
    assert node._settings.camera_tilt == pytest.approx(0.3)
    assert node._settings.camera_yaw == pytest.approx(0.1)
    # The camera is level: who drew it was wrong, and that is found out.
    assert node._state.view.memory.attitude.tilt == pytest.approx(0.0, abs=0.03)
    line = '/tf_static: camera_optical_frame sits at tilt 17.2 deg, roll -5.7 deg'
    bench.until(lambda: bool(bench.logged(line)), 'the log')
    bench.until(lambda: len(heard) == 2, 'the settings, announced anew')
    settings = settings_text.from_text(heard[-1].data)
    assert settings.values['camera_tilt'] == pytest.approx(0.3)
    assert settings.after_stamp_ns is None  # they hold for the first tracks as well


def test_a_chain_of_frames_is_followed(bench) -> None:
    node = started(bench)
    told(
        node, transforms.mount_transform('mast', 'camera_link', UPRIGHT, np.array([0.1, 0.0, 0.3]))
    )
    told(
        node, transforms.mount_transform('base_link', 'mast', UPRIGHT, np.array([0.1, 0.05, 0.2]))
    )
    told(node, mounted('camera_link', mount=CameraMount(0.0, 0.0, 0.3, -0.1, 0.0, 0.1)))
    see(bench, node)
    assert node._settings.camera_roll == pytest.approx(-0.1)
    assert node._settings.camera_forward == pytest.approx(0.2)
    assert node._settings.camera_left == pytest.approx(0.05)


@pytest.mark.parametrize('slashed', [{'frame'}, {'child'}, {'base_frame'}, {'frame', 'mast'}])
def test_a_leading_slash_of_ros_1_names_the_same_frame(bench, slashed) -> None:
    names = {
        'frame': 'camera_optical_frame',
        'child': 'camera_optical_frame',
        'base_frame': 'base_link',
        'mast': 'mast',
    }
    names |= {key: f'/{names[key]}' for key in slashed}
    node = started(bench, base_frame=names['base_frame'])
    told(node, mounted(names['mast'], names['child']))
    told(node, transforms.mount_transform('base_link', 'mast', UPRIGHT, np.zeros(3)))
    see(bench, node, frame=names['frame'])
    assert node._settings.camera_tilt == pytest.approx(0.3)


@pytest.mark.parametrize(
    ('edges', 'has'),
    [
        ([mounted(child='lidar')], 'it has lidar'),
        ([mounted('mast')], 'it has camera_optical_frame'),
        ([], 'it has nothing'),
    ],
)
def test_a_camera_that_it_does_not_lead_to_is_told_once(bench, monkeypatch, edges, has) -> None:
    monkeypatch.setattr(transforms, 'tf_message_class', lambda: String)  # as if it were installed
    node = started(bench)
    told(node, *edges)
    for number in range(3):
        see(bench, node, STAMP_NS + number)
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
def test_otherwise_the_settings_stay(bench, values, edges) -> None:
    node = started(bench, **values)
    before = node._settings
    told(node, *edges)
    see(bench, node)
    assert node._settings == before


def test_without_tf2_msgs_it_says_so(bench, monkeypatch) -> None:
    monkeypatch.setattr(transforms, 'tf_message_class', lambda: None)
    node = started(bench)
    text = 'tf2_msgs cannot be imported, mount_from_tf has no effect; install ros-jazzy-tf2-msgs'
    bench.until(lambda: bool(bench.logged(text)), 'the warning')
    see(bench, node)  # by what it cannot hear no frame_id is found wrong
    assert not bench.logged('/tf_static does not lead')


def test_unless_it_is_wanted_nobody_listens(bench) -> None:
    node = bench.start(ServoNode)
    assert '/tf_static' not in {item.topic_name for item in node.subscriptions}


def test_what_comes_in_mid_run_waits_for_the_next(bench) -> None:
    node = started(bench)
    see(bench, node)
    told(node, mounted())
    see(bench, node, STAMP_NS + 1)
    assert node._settings.camera_tilt == 0.0
    assert bench.call('servo_node/stop').success
    assert bench.call('servo_node/start').success
    see(bench, node, STAMP_NS + 2)
    assert node._settings.camera_tilt == pytest.approx(0.3)


def test_a_cleanup_forgets_the_mount(bench) -> None:
    node = started(bench)
    told(node, mounted())
    see(bench, node)
    go(bench, node, 'deactivate', 'cleanup')
    assert not node._settings.mount_is_told
    go(bench, node, 'configure', 'activate')
    told(node, mounted(mount=replace(MOUNT, tilt=0.2)))
    see(bench, node, STAMP_NS + 1)
    assert node._settings.camera_tilt == pytest.approx(0.2)


@pytest.mark.parametrize(
    ('mount', 'why'),
    [
        (UPRIGHT, 'an optical frame looks ahead'),
        (replace(MOUNT, yaw=math.pi).R_world_camera(BASE), 'camera_yaw must lie in'),
    ],
)
def test_by_a_mount_that_cannot_be_used_nobody_drives(bench, mount, why) -> None:
    commands = bench.listen(Twist, 'cmd_vel', qos.COMMAND)
    node = started(bench)
    before = node._settings
    told(node, transforms.mount_transform('base_link', 'camera', mount, np.zeros(3)))
    see(bench, node, frame='camera')
    assert node._settings == before
    bench.until(lambda: bool(bench.logged(why)), 'the warning')
    assert node._state.phase is Phase.WAITING and not commands
    reason, alarming = node._standstill()
    assert 'the mount of camera in /tf_static cannot be used' in reason and alarming
    # Another description of the robot is one that it can drive by.
    told(node, mounted(child='camera'))
    see(bench, node, STAMP_NS + 1, frame='camera')
    assert node._state.phase is not Phase.WAITING


def test_a_broken_transform_is_said_and_left_out(bench) -> None:
    node = started(bench)
    broken = mounted()
    broken.transform.rotation.w = math.nan
    told(node, broken)
    see(bench, node)
    assert node._settings.camera_tilt == 0.0
    line = 'the transform to camera_optical_frame must be finite'
    bench.until(lambda: bool(bench.logged(line)), 'the warning')


def test_with_the_real_tf2_msgs_it_is_heard(bench) -> None:
    kind = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs is not installed').TFMessage
    bench.talk(kind, '/tf_static', qos.STATIC_TRANSFORMS)(kind(transforms=[mounted()]))
    node = started(bench)
    bench.until(lambda: bool(node._camera.static_mount._parents), '/tf_static')
    see(bench, node)
    assert node._settings.camera_tilt == pytest.approx(0.3)
