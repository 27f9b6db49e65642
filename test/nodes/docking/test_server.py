"""The action server: goals become tasks of the servo; cancels and failures end as they should."""

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import Twist as TwistMessage
import pytest
from rclpy.node import Node
from sensor_msgs.msg import BatteryState

pytest.importorskip('test_msgs', reason='pip install ros-jazzy-test-msgs==2.0.3')

from dock_requests import Client, drives, Led, SERVED, served, Servo, started  # noqa: E402
from fibonacci_wire import BY_POSE  # noqa: E402

from visual_servo_epipolar.core.docking.task import Error, State  # noqa: E402
from visual_servo_epipolar.core.laws.phase import Phase  # noqa: E402
from visual_servo_epipolar.nodes import qos  # noqa: E402


@pytest.fixture
def servo(bench):
    return Servo(bench)


@pytest.fixture
def client(bench, servo):
    bench.start(served, **SERVED)
    made = Client(bench)
    yield made
    made.close()


def test_it_docks(bench, servo, client) -> None:
    _, result = client.ask()
    started(bench, servo)
    assert servo.calls == ['stop', 'start']
    drives(bench, servo, client, Phase.RETREATING)
    drives(bench, servo, client)
    servo.say(Phase.ARRIVED)
    assert client.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])
    assert client.states() == [2, 1, 3]
    assert servo.calls == ['stop', 'start']


def test_a_failure_is_tried_again_and_counted(bench, servo, client) -> None:
    _, result = client.ask()
    started(bench, servo)
    drives(bench, servo, client)
    servo.say(Phase.FAILED)
    started(bench, servo, 2)
    drives(bench, servo, client)
    servo.say(Phase.ARRIVED)
    assert client.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 1])
    assert State.RETRY in client.states()


def test_the_last_failure_is_the_error(bench, servo, client) -> None:
    _, result = client.ask()
    for count in (1, 2):
        started(bench, servo, count)
        servo.say(Phase.RETREATING)
        servo.say(Phase.FAILED)
    bench.until(lambda: bench.logged('dock_robot: attempt 2'), 'the attempt in the log')
    expected = [0, int(Error.FAILED_TO_STAGE), 1]
    assert client.outcome(result) == (GoalStatus.STATUS_ABORTED, expected)
    bench.until(lambda: servo.calls[-1] == 'stop', 'the servo to be stopped')


def test_a_failure_is_logged_with_its_reason(bench, servo, client) -> None:
    _, result = client.ask()
    for count in (1, 2):
        started(bench, servo, count)
        drives(bench, servo, client)
        servo.say(Phase.FAILED, f'the reason of attempt {count}')
    assert client.outcome(result)[0] == GoalStatus.STATUS_ABORTED
    assert bench.logged('dock_robot: the reason of attempt 2')


def test_a_cancel_stops_the_servo(bench, servo, client) -> None:
    goal, result = client.ask()
    started(bench, servo)
    drives(bench, servo, client)
    goal.cancel_goal_async()
    assert client.outcome(result) == (GoalStatus.STATUS_CANCELED, [0, 0, 0])
    bench.until(lambda: servo.calls == ['stop', 'start', 'stop'], 'the servo to be stopped')


def test_another_goal_aborts_the_first_and_docks(bench, servo, client) -> None:
    _, first = client.ask()
    started(bench, servo)
    drives(bench, servo, client)
    _, second = client.ask()
    assert client.outcome(first)[0] == GoalStatus.STATUS_ABORTED
    started(bench, servo, 2)
    servo.say(Phase.DISPLACING)
    servo.say(Phase.ARRIVED)
    assert client.outcome(second) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])


def test_goals_come_one_after_the_other(bench, servo, client) -> None:
    for count in (1, 2, 3):
        _, result = client.ask()
        started(bench, servo, count)
        servo.say(Phase.DISPLACING)
        servo.say(Phase.ARRIVED)
        assert client.outcome(result)[0] == GoalStatus.STATUS_SUCCEEDED


def test_a_request_that_cannot_be_served_starts_nothing(bench, servo, client) -> None:
    _, result = client.ask(BY_POSE)
    expected = [0, int(Error.DOCK_NOT_VALID), 0]
    assert client.outcome(result) == (GoalStatus.STATUS_ABORTED, expected)
    assert 'start' not in servo.calls


def test_a_servo_that_refuses_is_an_unknown_error(bench, servo, client) -> None:
    servo.refuses = True
    _, result = client.ask()
    assert client.outcome(result)[1] == [0, int(Error.UNKNOWN), 0]


def test_a_servo_that_is_not_there_is_an_unknown_error(bench) -> None:
    bench.start(served, **SERVED)
    client = Client(bench)
    _, result = client.ask()
    assert client.outcome(result)[1] == [0, int(Error.UNKNOWN), 0]
    assert bench.logged('service /servo_node/stop is not available')
    client.close()


def test_an_end_of_the_node_stops_the_servo(bench, servo, client) -> None:
    client.ask()
    started(bench, servo)
    drives(bench, servo, client)
    next(node for node in bench.nodes if node.get_name() == 'dock_node').stop()
    bench.until(lambda: servo.calls[-1] == 'stop', 'the servo to be stopped')


def test_a_servo_that_commands_the_base_itself_cannot_dock_backward(bench) -> None:
    it = Led(bench)
    servo = bench.add(Node('servo_node', context=bench.context))
    publisher = servo.create_publisher(TwistMessage, 'cmd_vel', qos.COMMAND)
    bench.until(lambda: bench.probe.count_publishers('cmd_vel') == 2, 'the servo on cmd_vel')
    _, result = it.client.ask()
    assert it.client.outcome(result)[0] == GoalStatus.STATUS_ABORTED
    assert not it.servo.calls
    text = '/servo_node commands /cmd_vel itself, and the camera looks back'
    bench.until(lambda: bool(bench.logged(text)), 'the reason')
    servo.destroy_publisher(publisher)
    bench.until(lambda: bench.probe.count_publishers('cmd_vel') == 1, 'the servo to be remapped')
    it.docking()
    it.client.close()


def test_where_it_charges_it_has_docked_once_there_is_a_current(bench, servo) -> None:
    battery = bench.talk(BatteryState, 'battery_state')
    bench.start(served, **SERVED, wait_for_charge=True)
    battery(BatteryState(current=1.0))  # before there is a request
    bench.settle()
    client = Client(bench)
    _, result = client.ask()
    started(bench, servo)
    drives(bench, servo, client)
    servo.say(Phase.ARRIVED)
    battery(BatteryState(current=-1.0))
    bench.until(lambda: client.states()[-1] == State.WAIT_FOR_CHARGE, 'the wait for a current')
    assert not result.done()
    battery(BatteryState(current=1.0))
    assert client.outcome(result) == (GoalStatus.STATUS_SUCCEEDED, [1, 0, 0])
    bench.until(lambda: bench.logged('docked, and charging'), 'why it has ended')
    client.close()
