"""Docking from end to end: requests, a real servo, a base; a failure, a retry, a cancel."""

from dataclasses import replace
import math

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from geometry_msgs.msg import Twist as TwistMessage
from lifecycles import go
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2

pytest.importorskip('test_msgs', reason='pip install ros-jazzy-test-msgs==2.0.3')

from docking_drives import CAMERA, true_dock  # noqa: E402
from fibonacci_wire import FibonacciWire  # noqa: E402
from rclpy.action import ActionClient  # noqa: E402
from test_msgs.action import Fibonacci  # noqa: E402

from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.docking.task import Error, State  # noqa: E402
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL  # noqa: E402
from visual_servo_epipolar.core.tracking.features import Features  # noqa: E402
from visual_servo_epipolar.messages import read, write  # noqa: E402
from visual_servo_epipolar.nodes.dock_node import DockNode  # noqa: E402
from visual_servo_epipolar.nodes.servo_node import ServoNode  # noqa: E402
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig  # noqa: E402
from visual_servo_epipolar.simulation.point_world import (  # noqa: E402
    PointSettings,
    PointWorld,
)

PERIOD_NS, PERIOD_S = 90_909_091, 0.090909091
PLACE_M, HEADING_RAD = 0.005, math.radians(0.2)
FORWARD = (0.2, -1.2, 4.0)
BACKWARD = (0.2, 1.2, -3.0)
HALF_WAY = -1.1
GOAL = 7  # the number of the photograph
GIVEN_UP = (GoalStatus.STATUS_ABORTED, [0, int(Error.UNKNOWN), 0])


class Robot:
    """A base that does what it is told, its camera, and who asks it to dock."""

    def __init__(self, bench, start, *, backward=False, odometry=False, **servo) -> None:
        self.bench, self.with_odometry, self.poses = bench, odometry, {}
        mount = CameraMount(yaw=math.pi) if backward else CameraMount()
        self.world = PointWorld(PointSettings(), FixedRig(CAMERA, mount), seed=1)
        self.pose, self.frame, self.blind = Pose.from_start(*start), 0, False
        self.commands = bench.listen(TwistMessage, 'cmd_vel')
        self.detected = bench.listen(PoseStamped, 'detected_dock_pose')
        self.tracks = bench.talk(PointCloud2, 'tracks')
        self.odometry = bench.talk(Odometry, 'odom')
        info = bench.talk(CameraInfo, 'camera_info')
        words = ['--ros-args', '-r', 'cmd_vel:=cmd_vel_reversed'] if backward else []
        self.servo = bench.start(
            lambda **options: ServoNode(cli_args=words, **options),
            stale_timeout=60.0,
            max_latency=0.0,
            **servo,
        )
        self.dock = bench.start(
            lambda **options: DockNode(FibonacciWire(), **options),
            serve_action=True,
            max_retries=2,
            servo_timeout=60.0,
            initial_perception_timeout=60.0,
            camera_yaw=math.pi if backward else 0.0,
        )
        info(write.camera_info(CAMERA, 0, 'camera'))
        bench.settle()
        self.client = ActionClient(bench.probe, Fibonacci, 'dock_robot')
        self.feedback = []
        self.step()  # or a start would be refused

    def ask(self):
        """Ask for docking, and wait until the servo has been started."""
        self.bench.until(self.client.server_is_ready, 'the action server')
        future = self.client.send_goal_async(
            Fibonacci.Goal(),
            feedback_callback=lambda item: self.feedback.append(list(item.feedback.sequence)),
        )
        self.bench.until(future.done, 'the goal to be accepted')
        self.started()
        return future.result(), future.result().get_result_async()

    def started(self) -> None:
        self.bench.until(lambda: self.run.active, 'the servo to be started')

    def step(self) -> None:
        """Look, wait for what is commanded, and obey for one period."""
        stamp_ns = (self.frame + 1) * PERIOD_NS
        heard, active = len(self.commands), self.run.active
        seen = Features() if self.blind else self.world.observe(self.pose, self.frame)
        self.poses[stamp_ns] = self.pose
        if self.with_odometry:  # without, the dock node has no path, and looks at no tracks
            told = write.odometry(self.pose, STANDSTILL, stamp_ns, 'odom', 'base_link')
            self.odometry(told)
        self.tracks(write.features(replace(seen, goal=GOAL), stamp_ns, 'camera'))
        self.bench.until(lambda: self.run.stamp_ns == stamp_ns, 'tracks to arrive')
        if active:
            ended = lambda: self.run.state.ended  # noqa: E731
            self.bench.until(lambda: len(self.commands) > heard or ended(), 'a command')
        self.frame += 1
        if len(self.commands) > heard:
            twist = read.twist(self.commands[-1])
            self.pose = integrate(self.pose, twist, PERIOD_S)

    def drive_until(self, condition, most=1200) -> None:
        for _ in range(most):
            if condition():
                return
            self.step()
        pytest.fail(f'not after {most} images: phase {self.run.state.phase.value}')

    def outcome(self, result):
        self.drive_until(result.done)
        return result.result().status, list(result.result().result.sequence)

    @property
    def run(self):
        """The run of the servo."""
        return self.servo._live

    @property
    def controls(self) -> bool:
        return bool(self.feedback) and self.feedback[-1][0] == State.CONTROLLING


@pytest.fixture
def robot(bench):
    made = []

    def make(*args, **values):
        made.append(Robot(bench, *args, **values))
        return made[0]

    yield make
    for each in made:
        each.client.destroy()


def assert_stands(it) -> None:
    it.bench.settle()
    assert read.twist(it.commands[-1]) == STANDSTILL
    stood = it.pose
    for _ in range(5):
        it.step()
    assert it.pose == stood


def assert_docked(robot) -> None:
    """Lateral, longitudinal and heading error of a base that stands at the dock."""
    assert abs(robot.pose.x) < PLACE_M
    assert abs(robot.pose.y) < PLACE_M
    assert abs(robot.pose.heading_error) < HEADING_RAD


def test_it_docks_forward_after_a_failure_and_a_retry(robot) -> None:
    it = robot(FORWARD, holding_timeout=1.0)
    _, result = it.ask()
    it.drive_until(lambda: it.controls and it.pose.y > HALF_WAY)
    it.blind = True  # somebody stands before the camera until the servo gives up
    it.drive_until(lambda: it.feedback[-1][0] == State.RETRY)
    it.blind = False
    it.started()
    assert it.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 1])
    assert_docked(it)


def test_it_docks_backward_with_a_camera_that_looks_back(robot) -> None:
    it = robot(BACKWARD, backward=True)
    _, result = it.ask()
    assert it.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])
    assert_docked(it)


def test_a_cancel_leaves_it_standing_and_another_request_docks(robot) -> None:
    it = robot(FORWARD)
    goal, result = it.ask()
    it.drive_until(lambda: it.controls and it.pose.y > HALF_WAY)
    goal.cancel_goal_async()
    it.bench.until(result.done, 'the result')
    assert result.result().status == GoalStatus.STATUS_CANCELED
    it.bench.until(lambda: not it.run.active, 'the servo to be stopped')
    assert_stands(it)
    _, result = it.ask()
    assert it.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])
    assert_docked(it)


@pytest.mark.parametrize(
    ('start', 'backward'),
    [(FORWARD, False), pytest.param(BACKWARD, True, marks=pytest.mark.long)],
    ids=['forward', 'backward'],
)
def test_a_deactivation_in_mid_docking_leaves_it_standing(robot, start, backward) -> None:
    it = robot(start, backward=backward)
    _, result = it.ask()
    it.drive_until(lambda: it.controls and abs(it.pose.y) < abs(HALF_WAY))
    assert read.twist(it.commands[-1]) != STANDSTILL
    go(it.bench, it.dock, 'deactivate')
    it.bench.until(lambda: not it.run.active, 'the servo to be stopped')
    it.bench.until(result.done, 'the result')
    assert (result.result().status, list(result.result().result.sequence)) == GIVEN_UP
    assert_stands(it)
    go(it.bench, it.dock, 'activate')
    _, result = it.ask()
    assert it.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])
    assert_docked(it)


def test_the_detected_pose_leads_to_where_it_docks(robot) -> None:
    it = robot(FORWARD, odometry=True)
    _, result = it.ask()
    assert it.outcome(result)[0] == GoalStatus.STATUS_SUCCEEDED
    it.bench.settle()
    errors = [
        math.hypot(*(true_dock(it.poses[read.stamp_ns(message.header)])[:2] - place(message)))
        for message in it.detected
    ]
    assert len(errors) > 20
    assert max(errors) < 0.2  # four of the deviations at which it is published
    assert errors[-1] < 0.01


def place(message):
    return np.array([message.pose.position.x, message.pose.position.y])


def test_it_refuses_to_dock_where_the_photograph_is_never_seen(robot) -> None:
    it = robot(FORWARD, holding_timeout=0.5)
    it.blind = True
    _, result = it.ask()
    stood = it.pose
    it.dock._server.settings = DockTaskSettings(max_retries=0, initial_perception_timeout=0.1)
    status, sequence = it.outcome(result)
    assert status == GoalStatus.STATUS_ABORTED
    assert sequence[:2] == [0, 904]
    assert it.pose == stood
