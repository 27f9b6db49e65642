"""The simulated camera as a node, and the tree of frames: world, odom, base_link, camera."""

import math

from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image
from small_cameras import MINUTE

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.messages import read, transforms, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.frames import TransformBroadcaster
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode
from visual_servo_epipolar.simulation.bases import LEVEL, Nod
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import published
from visual_servo_epipolar.simulation.sensor import CameraMotion

PERIOD_NS = period_ns(11.0)
POSE = Pose.from_start(0.3, -2.2, 5.0)


class Camera:
    """A running camera node, told where the robot is message by message."""

    def __init__(self, bench, **values) -> None:
        self.bench = bench
        self.images = bench.listen(Image, 'image_raw')
        self.infos = bench.listen(CameraInfo, 'camera_info')
        self._truth = bench.talk(Odometry, 'ground_truth')
        self.node = bench.start(CameraNode, **{**MINUTE, **values})
        self.simulator = CameraSimulator(CameraSettings(**{**MINUTE, **values}))

    def stamps(self) -> list[int]:
        return [read.stamp_ns(message.header) for message in self.images]

    def see(self, stamp_ns, pose=POSE) -> None:
        self.tell(write.odometry(pose, STANDSTILL, stamp_ns, 'world', 'base_link'))

    def tell(self, message) -> None:
        """Publish ground truth, and wait until the node has dealt with it."""
        self._truth(message)
        self.bench.settle()


@pytest.fixture
def camera(bench):
    return Camera(bench)


@pytest.mark.parametrize(('encoding', 'step'), [('mono8', 64), ('bgr8', 3 * 64)])
def test_the_image_is_what_the_simulation_sees_from_there(bench, encoding, step) -> None:
    camera = Camera(bench, encoding=encoding)
    camera.see(0)
    assert (camera.images[0].encoding, camera.images[0].step) == (encoding, step)
    expected = camera.simulator.capture(published(POSE), 0)
    np.testing.assert_array_equal(read.gray(camera.images[0]), expected)


def test_a_setting_changed_on_the_way_counts_from_the_next_image(bench) -> None:
    camera = Camera(bench)
    for number, (name, value) in enumerate({'jitter': 0.05, 'light': 'lamp_side'}.items()):
        camera.node.set_parameters([Parameter(name, value=value)])
        camera.see(number * PERIOD_NS)
    simulator = CameraSimulator(CameraSettings(**MINUTE, jitter=0.05))
    expected = [simulator.capture(published(POSE), number) for number in (0, 1)]
    np.testing.assert_array_equal(read.gray(camera.images[0]), expected[0])
    assert not np.array_equal(read.gray(camera.images[1]), expected[1])


@pytest.mark.parametrize(
    ('model', 'distortion'),
    [
        ('plumb_bob', (0.1, -0.01, 0.001, 0.002, 0.0)),
        ('equidistant', (-0.01, 0.002, 0.0, 0.0)),
        ('rational_polynomial', (0.2, 0.02, 0.001, -0.002, 0.001, 0.3, 0.05, 0.002)),
    ],
)
def test_every_lens_is_published_as_it_is_simulated(bench, model, distortion) -> None:
    camera = Camera(bench, distortion_model=model, distortion=distortion)
    camera.see(0)
    info = camera.infos[0]
    assert (info.width, info.height) == (64, 48)
    assert list(info.k) == [40.0, 0.0, 31.25, 0.0, 40.0, 23.5, 0.0, 0.0, 1.0]
    assert list(info.p) == [40.0, 0.0, 31.25, 0.0, 0.0, 40.0, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert (info.distortion_model, tuple(info.d)) == (model, distortion)
    assert read.camera(info) == camera.simulator.camera
    assert (camera.images[0].width, camera.images[0].height) == (64, 48)


def test_a_late_listener_still_gets_the_photograph(camera) -> None:
    camera.see(0)
    photographs = camera.bench.listen(Image, 'desired/image_raw', qos.LATCHED)
    camera.bench.until(lambda: bool(photographs), 'the photograph')
    np.testing.assert_array_equal(read.gray(photographs[0]), camera.simulator.photograph())


LATE_NS = 7_000_000
ON_TIME = [0, PERIOD_NS + LATE_NS, 2 * PERIOD_NS + LATE_NS // 2, 3 * PERIOD_NS]


@pytest.mark.parametrize(
    ('delay', 'truth_ns', 'image_ns'),
    [
        pytest.param(
            0.0,
            [0, 10_000_000, PERIOD_NS - 1, PERIOD_NS, PERIOD_NS + 1, 2 * PERIOD_NS],
            [0, PERIOD_NS, 2 * PERIOD_NS],
            id='only when a frame has passed',
        ),
        pytest.param(0.0, ON_TIME, ON_TIME, id='lateness does not add up'),
        pytest.param(
            0.0,
            [100 * PERIOD_NS, 0, PERIOD_NS],
            [100 * PERIOD_NS, 0, PERIOD_NS],
            id='time runs backwards',
        ),
        pytest.param(
            1.5,
            [0, PERIOD_NS, 2 * PERIOD_NS, 3 * PERIOD_NS],
            [2 * PERIOD_NS, 3 * PERIOD_NS],
            id='one that is late is stamped when it comes',
        ),
    ],
)
def test_images_are_taken_frame_by_frame(bench, delay, truth_ns, image_ns) -> None:
    camera = Camera(bench, stamp_delay=delay * PERIOD_NS * 1e-9)
    for stamp_ns in truth_ns:
        camera.see(stamp_ns)
    assert camera.stamps() == image_ns
    assert [read.stamp_ns(message.header) for message in camera.infos] == image_ns


def test_the_image_leans_with_the_body_of_the_truth(camera) -> None:
    nod = Nod(0.1, 0.2)
    camera.tell(write.odometry(POSE, STANDSTILL, 0, 'world', 'base_link', pitch=nod))
    simulator, images = camera.simulator, []
    for body in (LEVEL, nod):
        images.append(simulator.capture(published(POSE), 0, CameraMotion(nod=body)))
    np.testing.assert_array_equal(read.gray(camera.images[0]), images[1])
    assert (images[0] != images[1]).mean() > 0.3


def test_a_pose_that_is_not_finite_is_refused_and_the_next_one_seen(camera) -> None:
    message = write.odometry(POSE, STANDSTILL, 0, 'world', 'base_link')
    message.pose.pose.position.x = float('nan')
    camera.tell(message)
    camera.bench.until(lambda: camera.bench.logged('a pose must be finite'), 'the error logged')
    assert camera.images == []
    camera.see(PERIOD_NS)
    assert camera.stamps() == [PERIOD_NS]


@pytest.fixture
def sent(monkeypatch):
    """Return the list of what the broadcasters are given to send."""
    messages = []
    monkeypatch.setattr(TransformBroadcaster, 'send', lambda _, each: messages.append(list(each)))
    return messages


def matrix(message):
    """Return a planar transform as a matrix, (3, 3)."""
    place, turn = message.transform.translation, message.transform.rotation
    cos, sin = turn.w**2 - turn.z**2, 2.0 * turn.w * turn.z
    return np.array([[cos, -sin, place.x], [sin, cos, place.y], [0.0, 0.0, 1.0]])


def test_the_tree_leads_from_the_world_to_where_the_robot_really_is(bench, sent) -> None:
    truth, odometry = bench.listen(Odometry, 'ground_truth'), bench.listen(Odometry, 'odom')
    command = bench.talk(TwistMessage, 'cmd_vel')
    values = {'lockstep': True, 'command_timeout': 0.0, 'odometry_noise': 0.5}
    node = bench.start(UnicycleNode, begin=False, **values)
    node.begin()
    for step in range(20):
        bench.until(lambda count=step + 1: len(truth) == count, 'the next frame')
        command(write.twist(Twist(0.5, 0.4)))
    bench.until(lambda: len(odometry) == len(truth) == 21, 'odometry beside the truth')
    to_odom, to_base = sent[-1]
    assert [message.header.frame_id for message in sent[-1]] == ['world', 'odom']
    assert [message.child_frame_id for message in sent[-1]] == ['odom', 'base_link']
    stamps = {read.stamp_ns(message.header) for message in sent[-1]}
    assert stamps == {read.stamp_ns(truth[-1].header)}
    pose, wheels = read.pose(truth[-1]), read.pose(odometry[-1])
    at = transforms.on_the_floor('world', 'base_link', pose, 0)
    np.testing.assert_allclose(matrix(to_odom) @ matrix(to_base), matrix(at), atol=1e-9)
    by_wheels = transforms.on_the_floor('odom', 'base_link', wheels, 0)
    np.testing.assert_allclose(matrix(to_base), matrix(by_wheels), atol=1e-9)
    assert not np.allclose(matrix(to_odom), matrix(sent[0][0]), atol=1e-3)  # it has drifted


def test_the_camera_hangs_on_the_base_once_and_for_all(bench, sent) -> None:
    bench.start(CameraNode, **MINUTE, mount_height=0.5, mount_forward=0.2, mount_yaw=0.2)
    ((mounted,),) = sent
    frames = mounted.header.frame_id, mounted.child_frame_id
    assert frames == ('base_link', 'camera_optical_frame')
    place = mounted.transform.translation
    np.testing.assert_allclose([place.x, place.y, place.z], [0.2, 0.0, 0.5])
    turn = mounted.transform.rotation
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    forward = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)]
    np.testing.assert_allclose(forward, [math.cos(0.2), math.sin(0.2), 0.0], atol=1e-12)


def test_frames_are_named_by_parameters(bench, sent) -> None:
    truth, odometry = bench.listen(Odometry, 'ground_truth'), bench.listen(Odometry, 'odom')
    images, infos = bench.listen(Image, 'image_raw'), bench.listen(CameraInfo, 'camera_info')
    node = bench.start(UnicycleNode, lockstep=True, begin=False, odom_frame='o', base_frame='b')
    bench.start(CameraNode, **MINUTE, camera_frame='eye_optical_frame', base_frame='b')
    node.begin()
    bench.until(lambda: bool(truth and odometry and images and infos), 'all of them')
    assert (truth[0].header.frame_id, truth[0].child_frame_id) == ('world', 'b')
    assert (odometry[0].header.frame_id, odometry[0].child_frame_id) == ('o', 'b')
    assert images[0].header.frame_id == infos[0].header.frame_id == 'eye_optical_frame'
    ends = [(it.header.frame_id, it.child_frame_id) for each in sent for it in each]
    assert ends == [('b', 'eye_optical_frame'), ('world', 'o'), ('o', 'b')]


def test_without_tf2_msgs_it_says_so_once(bench, monkeypatch) -> None:
    monkeypatch.setattr(transforms, 'tf_message_class', lambda: None)
    truth = bench.listen(Odometry, 'ground_truth')
    node = bench.start(UnicycleNode)
    bench.until(lambda: len(truth) > 5, 'ground truth')
    assert not [item for item in node.publishers if item.topic_name.startswith('/tf')]
    assert len(bench.logged('tf2_msgs cannot be imported, /tf is not published')) == 1


def test_with_the_real_tf2_msgs_the_tree_is_on_tf_and_tf_static(bench) -> None:
    kind = pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs is not installed').TFMessage
    moving = bench.listen(kind, '/tf', qos.TRANSFORMS)
    bench.start(UnicycleNode)
    bench.start(CameraNode, **MINUTE)
    fixed = bench.listen(kind, '/tf_static', qos.LATCHED)  # also a late listener
    bench.until(lambda: bool(moving and fixed), 'both topics')
    assert [item.child_frame_id for item in moving[0].transforms] == ['odom', 'base_link']
    assert [item.child_frame_id for item in fixed[0].transforms] == ['camera_optical_frame']
