"""The dock node: tracks and odometry in, the dock's pose out, and nothing before it is known."""

import re

from diagnostic_msgs.msg import DiagnosticArray
from docking_drives import CAMERA, PERIOD_NS, PERIOD_S, true_dock
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from lifecycles import go
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist, yaw_from_quaternion
from visual_servo_epipolar.core.stamps import NOT_ADVANCING
from visual_servo_epipolar.messages import docking, read, write
from visual_servo_epipolar.nodes.dock_node import DockNode
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import SimulatedRig

FRAMES = 10
TWIST = Twist(0.4, 0.05)
START = Pose.from_start(0.3, -2.0, 4.0)


class Rig:
    """A dock node, and a robot that drives towards the photograph with perfect odometry."""

    def __init__(self, bench, *, calibrated=True, **values) -> None:
        self.bench = bench
        self.poses = bench.listen(PoseStamped, 'detected_dock_pose')
        self.uncertain = bench.listen(
            PoseWithCovarianceStamped, 'detected_dock_pose_with_covariance'
        )
        self._reports = bench.listen(DiagnosticArray, '/diagnostics')
        self.tracks = bench.talk(PointCloud2, 'tracks')
        self.odometry = bench.talk(Odometry, 'odom')
        self.info = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(DockNode, **values)
        self.world = PointWorld(PointSettings(), SimulatedRig(CAMERA), seed=0)
        self.pose, self.told, self.frame = START, Pose(5.0, 3.0, 1.0), 0
        if calibrated:
            self.calibrate()

    @property
    def reports(self):
        """What the dock node reports: a servo does on that topic, too."""
        return [it for it in self._reports if it.status[0].name == '/dock_node']

    def calibrate(self, camera=CAMERA) -> None:
        self.info(write.camera_info(camera, 0, 'camera'))
        self.bench.settle()

    @property
    def stamp_ns(self) -> int:
        return (self.frame + 1) * PERIOD_NS

    def tell_odometry(self) -> None:
        message = write.odometry(self.told, TWIST, self.stamp_ns, 'odom', 'base_link')
        self.odometry(message)

    def see(self) -> None:
        features = self.world.observe(self.pose, self.frame)
        self.tracks(write.features(features, self.stamp_ns, 'camera'))

    def step(self) -> None:
        """See, hear of it, and drive on."""
        count = len(self.reports)
        self.tell_odometry()
        self.see()
        self.bench.until(lambda: len(self.reports) > count, 'the tracks to be looked at')
        self.advance()

    def advance(self) -> None:
        """Drive on by one frame."""
        self.frame += 1
        self.before = self.pose
        self.pose = integrate(self.pose, TWIST, PERIOD_S)
        self.told = integrate(self.told, TWIST, PERIOD_S)

    def drive(self, frames=FRAMES):
        """Drive, and return how many poses were published on the way."""
        count = len(self.poses)
        for _ in range(frames):
            self.step()
        self.bench.settle()
        return len(self.poses) - count


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
