"""The dock node: tracks and odometry in, the dock's pose out, and nothing before it is known."""

from dataclasses import replace
import math
import re
from types import SimpleNamespace

from bench import Bench
from dock_rig import Rig, TWIST
from docking_drives import CAMERA, PERIOD_NS, true_dock
from geometry_msgs.msg import Quaternion, TwistStamped
from geometry_msgs.msg import Twist as TwistMessage
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist, yaw_from_quaternion
from visual_servo_epipolar.messages import docking, read, transforms, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.dock_node import DockNode, NO_NAV2
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount


def planar(message):
    place, turn = message.pose.position, message.pose.orientation
    return np.array([place.x, place.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)])


def test_the_pose_is_that_of_the_base_at_the_photograph(bench) -> None:
    rig = Rig(bench).drive()
    message, pose = rig.poses[-1], rig.before[0]
    assert message.header.frame_id == 'base_link'
    assert read.stamp_ns(message.header) == rig.stamp_ns - PERIOD_NS
    assert planar(message) == pytest.approx(true_dock(pose), abs=0.03)
    covariance = rig.uncertain[-1].pose.covariance.reshape(6, 6)
    apart = (planar(message) - true_dock(pose))[:2]
    assert apart @ np.linalg.solve(covariance[:2, :2], apart) < 16.0
    assert covariance[2, 2] == write.UNMEASURED


@pytest.mark.parametrize('word', ['auto', 'reliable'])
def test_a_camera_info_that_was_latched_before_is_heard(bench, word) -> None:
    bench.talk(CameraInfo, 'camera_info', qos.LATCHED)(write.camera_info(CAMERA, 0, 'camera'))
    node = bench.start(DockNode, camera_reliability=word)
    bench.until(lambda: node._camera is not None, 'the camera_info of before')


def test_nothing_is_published_before_it_is_known(bench) -> None:
    rig = Rig(bench, publish_deviation=0.001).drive(5)
    assert rig.poses == [] == rig.uncertain
    assert 'uncertain by' in read.diagnosis(rig.reports[-1])['unpublished_because']


def test_without_a_path_nothing_is_published(bench) -> None:
    rig = Rig(bench)
    see_in_vain(rig)
    missing = 'nothing usable came on /odom yet; start what publishes it, or remap it'
    rig.bench.until(lambda: rig.bench.logged(missing), 'what is missing')


def test_a_base_that_takes_another_type_than_the_turned_commands_is_named(two_processes) -> None:
    bench, other = two_processes
    other.listen(TwistStamped, 'cmd_vel')
    rig = Rig(bench, serve_action=True, camera_yaw=3.14)
    bench.until(lambda: rig.node._notice, 'the base')
    rig.drive()
    text = 'takes geometry_msgs/TwistStamped on /cmd_vel, /dock_node publishes geometry_msgs/Twist'
    assert text in rig.reports[-1].status[0].message


@pytest.mark.parametrize(
    ('ahead', 'words'),
    [
        (0, '/odom is 0.20 s older than the image, stamped 0.20 s and 0.40 s; look at its rate'),
        (20, '/odom is 3.80 s newer than the image, stamped 4.20 s and 0.40 s; look at its rate'),
        (10**9, '/odom is 199999999.80 s newer than the image, stamped 200000000.20 s and 0.40 s'),
    ],
)
def test_both_clocks_are_named(bench, ahead: int, words: str) -> None:
    rig = Rig(bench)
    rig.frame += ahead
    rig.tell_odometry()
    rig.frame += 1 - ahead
    see_in_vain(rig)
    rig.bench.until(lambda: rig.bench.logged(words), 'what is missing')


def test_a_camera_that_is_silent_is_what_is_missing(bench) -> None:
    rig = Rig(bench, calibrated=False)
    see_in_vain(rig)
    rig.bench.until(lambda: rig.bench.logged('no usable camera_info yet'), 'what is missing')
    assert not rig.bench.logged('odom')


def see_in_vain(rig) -> None:
    for _ in range(15):
        rig.see()
        rig.bench.settle()
        rig.frame += 1
    assert rig.reports == [] == rig.poses


def test_odometry_of_two_is_named_with_its_publishers(bench) -> None:
    rig = Rig(bench).drive(2)
    for frame in ('odom', 'ekf'):
        stamp_ns = rig.stamp_ns + (frame == 'ekf') * PERIOD_NS // 2
        rig.odometry(write.odometry(rig.told, TWIST, stamp_ns, frame, 'base_link'))
    words = '/odom is in the frame ekf, was in odom before; look at what publishes it: /probe'
    bench.until(lambda: bench.logged(words), 'the complaint')


def test_a_reset_looks_for_it_anew(bench) -> None:
    rig = Rig(bench).drive()
    count = len(rig.poses)
    assert count
    assert bench.call('dock_node/reset').success
    rig.drive(1)
    assert len(rig.poses) == count


def test_a_camera_looking_back_has_its_commands_turned_round(bench) -> None:
    heard = bench.listen(TwistMessage, 'cmd_vel')
    bench.start(DockNode, serve_action=True, camera_yaw=3.14)
    say = bench.talk(TwistMessage, 'cmd_vel_reversed')
    say(write.twist(Twist(0.3, 0.2)))
    bench.until(lambda: len(heard) == 1, 'the command')
    assert read.twist(heard[0]) == Twist(-0.3, 0.2)
    broken = TwistMessage()
    broken.linear.x = math.nan
    say(broken)
    bench.until(lambda: len(heard) == 2, 'the standstill')
    assert read.twist(heard[1]) == Twist(0.0, 0.0)


def test_without_it_no_command_is_touched(bench) -> None:
    node = bench.start(DockNode)
    assert not [item for item in node.publishers if item.topic_name == '/cmd_vel']


def test_without_nav2_msgs_the_action_is_missed_in_one_line(bench, monkeypatch) -> None:
    monkeypatch.setattr(docking, 'dock_robot_wire', lambda: None)
    bench.start(DockNode, serve_action=True)
    bench.until(lambda: bench.logged(NO_NAV2), 'what is missing')


def test_who_serves_the_action_says_that_it_does_not_undock(bench) -> None:
    wire = pytest.importorskip('fibonacci_wire', exc_type=ImportError)
    bench.start(lambda **options: DockNode(wire.FibonacciWire(), **options), serve_action=True)
    bench.until(lambda: bench.logged('undock_robot is not'), 'what is not served')


def test_without_serve_action_nothing_is_said_of_nav2(bench, monkeypatch) -> None:
    monkeypatch.setattr(docking, 'dock_robot_wire', lambda: None)
    bench.start(DockNode)
    bench.settle()
    assert not bench.logged('nav2_msgs')


@pytest.mark.parametrize(
    ('name', 'value', 'today'),
    [
        ('dock_backwards', True, 'camera_yaw beyond 1.57'),
        ('path_source', 'commands', 'odometry alone, on odom'),
        ('pose_frame', 'odometry', 'the base alone, by child_frame_id of odom'),
        ('servo', 'other', '-r servo_node/start:=NAME/start'),
        ('key_views', 5, 'gone, 10 holds'),
    ],
)
def test_a_name_of_an_earlier_version_is_refused_with_what_holds_today(
    bench, name, value, today
) -> None:
    with pytest.raises(ValueError, match=f'{name}.* {re.escape(today)}'):
        bench.start(DockNode, **{name: value})


def test_a_camera_that_looks_back_by_tf_alone_cannot_dock(bench) -> None:
    rig = Rig(bench)
    rig.node._settings = replace(rig.settings, camera_yaw=3.14)
    assert rig.node._refusal().startswith('the camera looks back by /tf_static: set camera_yaw')


def test_the_frame_is_that_of_the_base_by_odometry(bench) -> None:
    rig = Rig(bench)
    rig.node._driven.base_frame = ''
    assert {message.header.frame_id for message in rig.drive().poses} == {'base_link'}


def test_a_camera_that_changes_begins_anew(bench) -> None:
    rig = Rig(bench).drive()
    other = CAMERA.__class__(1280, 1024, 800.0, 800.0, 635.0, 512.0)
    rig.info(write.camera_info(other, 0, 'camera'))
    bench.until(lambda: bench.logged('camera_info has changed'), 'what happened')
    told = len(rig.poses)
    rig.drive(1)
    assert len(rig.poses) == told


def test_a_reset_forgets_the_mount_of_tf_static(bench) -> None:
    rig = Rig(bench, mount_from_tf=True)
    level = CameraMount().R_world_camera(Pose(0.0, 0.0, 0.0))

    def sits(forward: float) -> None:
        place = np.array([forward, 0.0, 0.6])
        edge = transforms.mount_transform('base_link', 'camera', level, place)
        rig.node._mount.receive(SimpleNamespace(transforms=[edge]))

    sits(0.1)
    rig.drive(1)
    assert rig.settings.camera_forward == pytest.approx(0.1)
    sits(0.2)
    rig.drive(1)
    assert rig.settings.camera_forward == pytest.approx(0.1)  # of what was seen
    assert bench.call('dock_node/reset').success
    assert rig.settings.camera_forward == 0.0
    rig.drive(1)
    assert rig.settings.camera_forward == pytest.approx(0.2)


@pytest.mark.parametrize(
    ('x', 'w', 'words'),
    [(math.nan, 1.0, 'a pose must be finite'), (0.0, 0.0, 'a quaternion of length 1, got length')],
)
def test_nonsense_is_refused_in_one_line(bench, x: float, w: float, words: str) -> None:
    rig = Rig(bench)
    message = write.odometry(rig.told, TWIST, rig.stamp_ns, 'odom', 'base_link')
    message.pose.pose.position.x = x
    message.pose.pose.orientation = Quaternion(w=w)
    rig.odometry(message)
    bench.until(lambda: bench.logged('odometry refused'), 'what was wrong')
    assert words in bench.logged('odometry refused')[0]
    rig.drive()
    assert rig.poses


AHEAD, BACK = Twist(0.3, 0.2), Twist(-0.3, 0.2)
STAMP_NS = 5_000_000_007


def test_a_stamped_command_keeps_its_stamp(bench: Bench) -> None:
    heard = bench.listen(TwistStamped, 'cmd_vel')
    command = bench.talk(TwistStamped, 'cmd_vel_reversed')
    bench.start(DockNode, serve_action=True, camera_yaw=3.14, enable_stamped_cmd_vel=True)
    command(write.twist_stamped(AHEAD, STAMP_NS, 'base_link'))
    bench.until(lambda: bool(heard), 'the command, turned round')
    assert (read.twist(heard[0]), read.stamp_ns(heard[0].header)) == (BACK, STAMP_NS)


@pytest.mark.parametrize('stamped', [False, True])
def test_at_a_broken_command_and_at_its_end_the_base_stands(bench: Bench, stamped: bool) -> None:
    kind = TwistStamped if stamped else TwistMessage
    heard, command = bench.listen(kind, 'cmd_vel'), bench.talk(kind, 'cmd_vel_reversed')
    node = bench.start(
        DockNode, serve_action=True, camera_yaw=3.14, enable_stamped_cmd_vel=stamped
    )
    broken = kind()
    (broken.twist if stamped else broken).linear.x = float('nan')
    command(broken)
    bench.until(lambda: len(heard) == 1, 'a command in place of the broken one')
    node.stop()
    bench.until(lambda: len(heard) == 2, 'the last command')
    assert [read.twist(message) for message in heard] == [STANDSTILL, STANDSTILL]
    bench.until(lambda: bool(bench.logged('nan')), 'what was wrong with it')
