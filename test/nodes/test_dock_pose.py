"""The dock node: tracks and odometry in, the dock's pose out, and nothing before it is known."""

import re

from dock_rig import Rig
from docking_drives import CAMERA, PERIOD_NS, true_dock
from lifecycles import go
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo

from visual_servo_epipolar.core.geometry.motion import yaw_from_quaternion
from visual_servo_epipolar.core.stamps import NOT_ADVANCING
from visual_servo_epipolar.messages import docking, read, write
from visual_servo_epipolar.nodes.dock_node import DockNode


def planar(message):
    place, turn = message.pose.position, message.pose.orientation
    return np.array([place.x, place.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)])


def test_the_pose_is_that_of_the_base_at_the_photograph(bench) -> None:
    rig = Rig(bench)
    assert rig.drive()
    message, pose = rig.poses[-1], rig.before
    assert message.header.frame_id == 'base_link'
    assert read.stamp_ns(message.header) == rig.stamp_ns - PERIOD_NS
    assert planar(message) == pytest.approx(true_dock(pose), abs=0.03)
    covariance = rig.uncertain[-1].pose.covariance.reshape(6, 6)
    apart = (planar(message) - true_dock(pose))[:2]
    assert apart @ np.linalg.solve(covariance[:2, :2], apart) < 16.0
    assert covariance[2, 2] == write.UNMEASURED


def test_nothing_is_published_before_it_is_known(bench) -> None:
    rig = Rig(bench, publish_deviation=0.001)
    assert not rig.drive(5)
    assert not rig.uncertain
    assert 'uncertain by' in read.diagnosis(rig.reports[-1])['unpublished_because']


@pytest.mark.parametrize(
    ('ahead', 'words'),
    [
        (None, 'nothing usable came on /odom yet; start what publishes it, or remap it'),
        (0, '/odom is 0.20 s older than the image, stamped 0.20 s and 0.40 s; look at its rate'),
        (20, '/odom is 3.80 s newer than the image, stamped 4.20 s and 0.40 s; look at its rate'),
    ],
)
def test_what_is_missing_of_odometry_is_logged_with_both_clocks(bench, ahead, words) -> None:
    rig = Rig(bench)
    if ahead is not None:
        rig.frame = ahead
        rig.tell_odometry()
        rig.frame = 1
    see_in_vain(rig)
    bench.until(lambda: bench.logged(words), 'what is missing')


def test_a_camera_that_is_silent_is_what_is_missing(bench) -> None:
    rig = Rig(bench, calibrated=False)
    see_in_vain(rig)
    bench.until(lambda: bench.logged('no usable camera_info yet'), 'what is missing')
    assert not bench.logged('odom')


def see_in_vain(rig) -> None:
    for _ in range(3):
        rig.see()
        rig.bench.settle()
        rig.frame += 1
    assert rig.reports == [] == rig.poses


def test_a_reset_and_another_camera_begin_anew(bench) -> None:
    rig = Rig(bench)
    assert rig.drive()
    assert bench.call('dock_node/reset').success
    assert not rig.drive(1)
    assert rig.drive()
    rig.info(CameraInfo())
    bench.until(lambda: bench.logged('camera_info cannot be used'), 'what is wrong')
    reports = len(rig.reports)
    rig.see()
    bench.settle()
    assert len(rig.reports) == reports
    rig.calibrate()
    rig.advance()
    rig.step()
    rig.info(write.camera_info(CAMERA.__class__(1280, 1024, 800.0, 800.0, 635.0, 512.0), 0, ''))
    bench.until(lambda: bench.logged('camera_info has changed'), 'what happened')
    assert not rig.drive(1)
    rig.calibrate(CAMERA.__class__(64, 48, 40.0, 40.0, 32.0, 24.0))
    rig.step()
    bench.until(lambda: bench.logged('64x48'), 'that tracks are not of this camera')


def test_of_a_bag_that_is_played_again_the_new_tracks_are_looked_at(bench) -> None:
    rig = Rig(bench)
    for rig.frame in (5, 1):
        rig.step()
    bench.until(lambda: bench.logged(NOT_ADVANCING), 'what is wrong with a stamp of before')


def test_active_again_it_takes_stamps_as_they_come(bench) -> None:
    rig = Rig(bench)
    rig.drive(2)
    go(bench, rig.node, 'deactivate', 'activate')
    rig.frame = 0
    rig.drive(1)
    assert not bench.logged(NOT_ADVANCING)


def test_without_nav2_msgs_the_action_is_missed_in_one_line(bench, monkeypatch) -> None:
    monkeypatch.setattr(docking, 'dock_robot_wire', lambda: None)
    bench.start(DockNode, serve_action=True)
    bench.until(lambda: bench.logged('nav2_msgs cannot be imported'), 'what is missing')


@pytest.mark.parametrize(
    ('name', 'value', 'today'),
    [
        ('dock_backwards', True, 'topic_tools'),
        ('path_source', 'commands', 'odometry alone, on odom'),
        ('pose_frame', 'odometry', 'the base alone, by child_frame_id of odom'),
        ('servo', 'other', '-r servo_node/start:=NAME/start'),
        ('key_views', 5, 'gone, 10 holds'),
        ('wait_for_charge', True, 'gone, False holds'),
        ('max_retries', 5, 'RetryUntilSuccessful of a behaviour tree'),
        ('dock_approach_timeout', 60.0, 'run_timeout of servo_node'),
    ],
)
def test_a_name_of_an_earlier_version_is_refused_with_what_holds_today(
    bench, name, value, today
) -> None:
    with pytest.raises(ValueError, match=f'{name}.* {re.escape(today)}'):
        bench.start(DockNode, **{name: value})
