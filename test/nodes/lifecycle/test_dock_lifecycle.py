"""The life cycle of the dock node: silent unless active, and what it moves stands at its end."""

import random

from action_msgs.msg import GoalStatus
from lifecycles import assert_cycles_leave_nothing, change, entities, go
import pytest
from rclpy.action import GoalResponse

pytest.importorskip('test_msgs', reason='pip install ros-jazzy-test-msgs==2.0.3')

from dock_requests import Led  # noqa: E402

from visual_servo_epipolar.core.docking.task import Error  # noqa: E402
from visual_servo_epipolar.core.laws.phase import Phase  # noqa: E402
from visual_servo_epipolar.nodes.dock_server import DEACTIVATED  # noqa: E402

GIVEN_UP = (GoalStatus.STATUS_ABORTED, [0, int(Error.UNKNOWN), 0])
DOCKED = (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])
LABELS = ('configure', 'cleanup', 'activate', 'deactivate')
STEPS = 40


@pytest.fixture
def led(bench):
    made = []

    def make(**values):
        made.append(Led(bench, **values))
        return made[0]

    yield make
    for each in made:
        each.client.close()


@pytest.mark.parametrize(
    'way',
    [
        (),
        ('configure',),
        ('configure', 'activate', 'deactivate'),
        ('configure', 'activate', 'deactivate', 'cleanup'),
        ('shutdown',),
    ],
)
def test_a_dock_node_that_is_not_active_is_silent_and_refuses_goals(bench, led, way) -> None:
    it = led(autostart_node=False)
    it.lead(*way)
    bench.settle()
    before = it.said()
    it.servo.say(Phase.DISPLACING)
    it.pass_by()
    assert not it.client.send().accepted
    it.node.stop()  # as a signal does
    bench.settle()
    assert it.said() == before
    reason = f'dock_robot refused: /dock_node is {it.node.state}; '
    bench.until(lambda: bool(bench.logged(reason)), 'the reason in the log')


def test_once_it_is_active_it_sees_and_docks(bench, led) -> None:
    it = led(autostart_node=False)
    go(bench, it.node, 'configure')
    it.pass_by()
    go(bench, it.node, 'activate')
    it.calibrate()
    it.drive(1)
    assert not it.poses  # what passed by before was not looked at
    assert it.drive().poses
    result = it.docking()
    it.servo.say(Phase.ARRIVED)
    assert it.client.outcome(result) == DOCKED


@pytest.mark.parametrize('way', [('deactivate',), ('deactivate', 'cleanup'), ('shutdown',)])
def test_in_mid_docking_the_robot_is_stopped_and_the_goal_ends(bench, led, way) -> None:
    it = led()
    result = it.docking()
    it.lead(*way)
    bench.until(lambda: it.servo.calls == ['stop', 'start', 'stop'], 'the servo to be stopped')
    bench.until(lambda: not it.moving, 'the zero twist')
    assert it.client.outcome(result) == GIVEN_UP
    assert bench.logged(f'dock_robot: {DEACTIVATED} (UNKNOWN)')
    before = it.said()
    it.servo.say(Phase.DISPLACING)
    it.pass_by()
    assert it.said() == before


def test_a_request_never_goes_on_by_itself_and_another_docks(bench, led) -> None:
    it = led()
    it.docking()
    go(bench, it.node, 'deactivate', 'activate')
    bench.settle()
    assert it.servo.calls == ['stop', 'start', 'stop']
    result = it.docking()
    it.servo.say(Phase.ARRIVED)
    assert it.client.outcome(result) == DOCKED


def test_what_has_docked_stays_docked(bench, led) -> None:
    it = led()
    result = it.docking()
    it.servo.say(Phase.ARRIVED)
    assert it.client.outcome(result) == DOCKED
    go(bench, it.node, 'deactivate')
    bench.settle()
    assert it.servo.calls == ['stop', 'start']


def test_a_goal_that_was_accepted_just_before_ends_and_orders_nothing(bench, led) -> None:
    it = led()

    def accept(goal):
        it.node.trigger_deactivate()
        return GoalResponse.ACCEPT

    it.node._server._server.register_goal_callback(accept)
    _, result = it.client.ask()
    assert it.client.outcome(result) == GIVEN_UP
    bench.settle()
    assert it.servo.calls == []


@pytest.mark.parametrize('cleanup', [False, True])
def test_a_servo_that_starts_after_the_end_is_stopped_again(bench, led, cleanup) -> None:
    it = led()

    def end() -> None:
        it.node.trigger_deactivate()  # which orders a stop; then comes the answer to the start
        if cleanup:
            it.node.trigger_cleanup()

    it.servo.on_start = end
    _, result = it.client.ask()
    assert it.client.outcome(result) == GIVEN_UP
    bench.until(lambda: it.servo.calls == ['stop', 'start', 'stop', 'stop'], 'both stops')


def test_the_camera_is_kept_while_inactive_and_the_dock_looked_for_anew(bench, led) -> None:
    it = led()
    assert it.drive().poses
    go(bench, it.node, 'deactivate', 'activate')
    told = len(it.poses)
    it.drive(1)
    assert len(it.poses) == told  # from one place no distance can be told
    assert len(it.drive().poses) > told
    go(bench, it.node, 'deactivate', 'cleanup', 'configure', 'activate')
    told = len(it.reports)
    it.see()
    it.tell_odometry()
    bench.settle()
    assert len(it.reports) == told  # it waits for camera_info


def test_configured_and_cleaned_up_again_and_again_it_leaves_nothing(bench, led) -> None:
    it = led(autostart_node=False, mount_from_tf=True, wait_for_charge=True)
    assert_cycles_leave_nothing(bench, it.node)
    bench.until(lambda: not bench.probe.count_publishers('/detected_dock_pose'), 'its topics to')


def test_led_about_at_random_in_mid_docking_it_moves_while_active_alone(bench, led) -> None:
    it, chance, before, runs = led(), random.Random(6), None, 0
    for _ in range(STEPS):
        active = it.node.is_active
        if active:
            result, runs = it.docking(), runs + 1
        else:
            said = it.said()
            it.command()
            assert not it.client.send().accepted
            assert it.said() == said
        change(bench, it.node, label=chance.choice(LABELS))
        if active and not it.node.is_active:
            assert it.client.outcome(result) == GIVEN_UP
            bench.until(lambda: it.servo.calls[-1] == 'stop', 'the servo to be stopped')
            bench.until(lambda: not it.moving, 'the zero twist')
        if it.node.state == 'unconfigured':
            before = before or entities(it.node)
            assert entities(it.node) == before
    assert runs >= 3
