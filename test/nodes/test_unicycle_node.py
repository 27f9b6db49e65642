"""The simulated base as a node: it moves on command, and stops without."""

import math

from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import pytest
from rclpy.parameter import Parameter

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode
from visual_servo_epipolar.simulation.closed_loop import published

START = (0.5, -2.0, 10.0)


def velocity(message):
    return read.twist(message.twist)


def start(bench, **values):
    """Return what to command with, and the ground truth heard."""
    stamped = values.get('enable_stamped_cmd_vel', False)
    command = bench.talk(TwistStamped if stamped else TwistMessage, 'cmd_vel')
    truth = bench.listen(Odometry, 'ground_truth')
    node = bench.start(UnicycleNode, start=START, **values)
    return node, command, truth


def wait_for_frames(bench, truth, count):
    bench.until(lambda: len(truth) >= count, f'{count} messages of ground truth')


def step(bench, command, truth, message):
    """Command the base in lockstep, and wait for the ground truth after it."""
    count = len(truth)
    command(message)
    wait_for_frames(bench, truth, count + 1)


def until_it_moves(bench, say, truth, speed) -> None:
    """Command by ``say`` until the base moves: on a busy machine a command may be too old."""
    moves = lambda: (truth and velocity(truth[-1]).linear > speed) or say()  # noqa: E731
    bench.until(moves, 'the base to move')


def test_it_stands_at_its_start_until_a_command_moves_it(bench) -> None:
    _, command, truth = start(bench)
    wait_for_frames(bench, truth, 2)
    assert read.pose(truth[-1]) == published(Pose.from_start(*START))
    until_it_moves(bench, lambda: command(write.twist(Twist(0.3, 0.0))), truth, 0.05)
    bench.until(lambda: read.pose(truth[-1]).y > START[1] + 0.01, 'the base to get on')


def test_it_stops_by_itself_when_commands_stay_away(bench) -> None:
    _, command, truth = start(bench, command_timeout=0.2)
    until_it_moves(bench, lambda: command(write.twist(Twist(0.3, 0.0))), truth, 0.0)
    began = len(truth)
    bench.until(lambda: velocity(truth[-1]) == STANDSTILL, 'the base to stop')
    # 0.2 s until it notices, 0.1 s to brake from 0.06 m/s. A busy machine ticks late, not more.
    assert len(truth) - began < 80  # at 100 Hz
    text = 'no cmd_vel for 0.2 s, the base stops'
    bench.until(lambda: bench.logged(text), text)


def test_a_timeout_of_zero_lets_it_run_on(bench) -> None:
    _, command, truth = start(bench, command_timeout=0.0, acceleration=20.0)
    command(write.twist(Twist(0.3, 0.0)))
    bench.until(lambda: truth and velocity(truth[-1]).linear == 0.3, 'full speed')
    first = read.stamp_ns(truth[-1].header)
    bench.until(lambda: read.stamp_ns(truth[-1].header) > first + 1.0e9, 'twice the timeout')
    assert velocity(truth[-1]).linear == 0.3


@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_a_command_that_is_not_finite_stops_it_and_is_logged_once(bench, clock, bad) -> None:
    _, command, truth = start(bench, command_timeout=0.0, lockstep=True)
    for _ in range(5):
        step(bench, command, truth, write.twist(Twist(0.3, 0.0)))
    assert velocity(truth[-1]).linear > 0.0
    message = write.twist(Twist(0.3, 0.0))
    message.angular.z = bad
    for _ in range(10):
        step(bench, command, truth, message)
    assert velocity(truth[-1]) == STANDSTILL
    assert math.isfinite(read.pose(truth[-1]).x)
    bench.until(lambda: bench.logged('a twist must be finite'), 'the error in the log')
    bench.settle()
    assert len(bench.logged('a twist must be finite')) == 1
    step(bench, command, truth, write.twist(Twist(0.3, 0.0)))
    assert velocity(truth[-1]).linear > 0.0


@pytest.mark.parametrize(
    ('values', 'is_old'),
    [({}, False), ({'command_timeout': 0.0}, True), ({'lockstep': True}, True)],
)
def test_it_takes_stamped_commands_also_old_ones_where_none_is_too_old(
    bench, values, is_old
) -> None:
    node, command, truth = start(bench, enable_stamped_cmd_vel=True, **values)

    def say() -> None:
        stamp_ns = 1 if is_old else node.get_clock().now().nanoseconds
        command(write.twist_stamped(Twist(0.3, 0.0), stamp_ns, 'base_link'))

    until_it_moves(bench, say, truth, 0.05)


def test_it_refuses_a_stamped_command_of_long_ago(bench) -> None:
    _, command, truth = start(bench, enable_stamped_cmd_vel=True)
    command(write.twist_stamped(Twist(0.3, 0.0), 1, 'base_link'))
    bench.until(lambda: bench.logged('a command must be younger'), 'the refusal in the log')
    bench.until(lambda: bool(truth), 'ground truth after it')
    assert velocity(truth[-1]) == STANDSTILL


def test_in_lockstep_nothing_moves_without_a_command(bench) -> None:
    _, _, truth = start(bench, lockstep=True)
    bench.settle()
    assert truth == []


def test_reset_brings_it_back_to_the_start(bench) -> None:
    node, command, truth = start(bench)
    until_it_moves(bench, lambda: command(write.twist(Twist(0.3, 0.3))), truth, 0.05)
    bench.settle()  # no command is on its way any more
    answer = bench.call('unicycle_node/reset')
    bench.settle()
    assert answer.success
    assert read.pose(truth[-1]) == published(Pose.from_start(*START))
    assert velocity(truth[-1]) == STANDSTILL


def test_a_new_start_counts_from_the_next_reset(bench) -> None:
    node, _, truth = start(bench, lockstep=True)
    node.set_parameters([Parameter('start', value=[-0.5, -3.0, 0.0])])
    answer = bench.call('unicycle_node/reset')
    bench.until(lambda: bool(truth), 'the pose after the reset')
    assert read.pose(truth[-1]) == published(Pose.from_start(-0.5, -3.0, 0.0))
    assert answer.message == 'at the start [-0.5, -3.0, 0.0]'


def test_a_limit_changed_on_the_way_holds_from_the_next_command(bench) -> None:
    node, command, truth = start(bench, lockstep=True, acceleration=20.0)
    node.set_parameters([Parameter('max_linear', value=0.25)])
    step(bench, command, truth, write.twist(Twist(0.5, 0.0)))
    assert velocity(truth[-1]).linear == 0.25


def test_odometry_drifts_away_from_the_truth_says_so_and_begins_anew_with_a_reset(bench) -> None:
    odometry = bench.listen(Odometry, 'odom')
    node, command, truth = start(bench, lockstep=True, command_timeout=0.0)
    node.begin()
    wait_for_frames(bench, truth, 1)
    for _ in range(44):
        step(bench, command, truth, write.twist(Twist(0.5, 0.0)))
    bench.until(lambda: len(odometry) == len(truth), 'odometry beside the truth')
    way = math.dist(position(truth[-1]), START[:2])
    error = abs(math.hypot(*position(odometry[-1])) - way)
    # 0.0075 a root metre of white noise: 1 cm after 1.7 m, five sigma allowed.
    assert 0.0 < error < 0.05
    assert way > 1.0
    assert not any(any(message.pose.covariance) for message in truth)
    variances = [message.pose.covariance[0] for message in odometry]
    assert 0.0 == variances[0] < variances[10] < variances[-1]
    assert bench.call('unicycle_node/reset').success
    bench.until(lambda: len(odometry) == 46, 'odometry after the reset')
    for message in (odometry[0], odometry[-1]):
        assert read.pose(message) == Pose(0.0, 0.0, 0.0)
    assert not odometry[-1].pose.covariance[0]


def position(message):
    pose = read.pose(message)
    return pose.x, pose.y
