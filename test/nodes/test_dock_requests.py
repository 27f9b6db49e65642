"""Requests to dock: a servo that is ordered about, and one that drives; failures, cancels."""

import itertools
import math

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from lifecycles import assert_cycles_leave_nothing, assert_gone_at_once, change, go
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

pytest.importorskip('test_msgs', reason='pip install ros-jazzy-test-msgs==2.0.3')

from docking_drives import true_dock  # noqa: E402
import fuzzing  # noqa: E402
from servo_rig import NOTHING, PERIOD_NS, Rig  # noqa: E402
from test_msgs.action import Fibonacci  # noqa: E402

from visual_servo_epipolar.core.docking.task import Error, Outcome, State  # noqa: E402
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL  # noqa: E402
from visual_servo_epipolar.core.laws.phase import Phase  # noqa: E402
from visual_servo_epipolar.core.servo.state import ServoState  # noqa: E402
from visual_servo_epipolar.messages import diagnostics, read, write  # noqa: E402
from visual_servo_epipolar.nodes.dock_node import DockNode  # noqa: E402

ABORTED, CANCELED = GoalStatus.STATUS_ABORTED, GoalStatus.STATUS_CANCELED
DOCKED = (GoalStatus.STATUS_SUCCEEDED, [1, 0])
GIVEN_UP = (ABORTED, [0, int(Error.UNKNOWN)])
SERVED = {'serve_action': True}
BY_POSE = 99  # as order: a request that no photograph can serve


class FibonacciWire:
    """An action in place of DockRobot: feedback is the state, the result success and error."""

    kind = Fibonacci

    def request(self, goal) -> tuple[bool, str]:
        return goal.order != BY_POSE, ''

    def feedback(self, state: State, seconds: float):
        assert seconds >= 0.0
        return Fibonacci.Feedback(sequence=[int(state)])

    def result(self, outcome: Outcome):
        return Fibonacci.Result(sequence=[int(outcome.success), int(outcome.error)])


def served(**options):
    """Return a dock node that serves the action which is at hand."""
    return DockNode(FibonacciWire(), **options)


class Servo:
    """What others see of a servo: services that are counted, and the phase that a test says."""

    def __init__(self, bench) -> None:
        self.bench, self.calls, self.refuses = bench, [], False
        self.on_start = lambda: None  # before it answers
        self._say = bench.talk(DiagnosticArray, '/diagnostics')
        bench.probe.create_service(Trigger, 'servo_node/start', self._serve('start'))
        bench.probe.create_service(Trigger, 'servo_node/stop', self._serve('stop'))

    def _serve(self, name):
        def serve(request, response):
            self.calls.append(name)
            response.success, response.message = not self.refuses, 'as you say'
            if name == 'stop':
                self.say(Phase.WAITING)
            else:
                self.on_start()
            return response

        return serve

    def say(self, *phases, reason='') -> None:
        for phase in phases:
            state = ServoState().changed(phase=phase, reason=reason)
            self._say(diagnostics.diagnosis(state, 1, name='/servo_node'))

    def started(self, count=1) -> None:
        self.bench.until(lambda: self.calls.count('start') == count, f'start {count}')
        self.bench.settle()

    def stopped(self, *calls) -> None:
        self.bench.until(lambda: self.calls[-1:] == ['stop'], 'the servo to be stopped')
        self.bench.settle()
        assert not calls or self.calls == list(calls)


class Client:
    """A client of dock_robot."""

    def __init__(self, bench) -> None:
        self.bench, self.feedback = bench, []
        self._client = ActionClient(bench.probe, Fibonacci, 'dock_robot')

    def close(self) -> None:
        self._client.destroy()

    def send(self, order=0):
        """Send a goal, and wait until it is accepted or refused."""
        self.bench.until(self._client.server_is_ready, 'the action server')
        future = self._client.send_goal_async(
            Fibonacci.Goal(order=order),
            feedback_callback=lambda item: self.feedback.append(list(item.feedback.sequence)),
        )
        self.bench.until(future.done, 'the answer to the goal')
        return future.result()

    def ask(self, order=0):
        """Send a goal that must be accepted."""
        goal = self.send(order)
        assert goal.accepted
        return goal, goal.get_result_async()

    def outcome(self, result):
        self.bench.until(result.done, 'the result')
        return result.result().status, list(result.result().result.sequence)

    def states(self):
        return [state for state, _ in itertools.groupby(item[0] for item in self.feedback)]

    def sees(self, state: State) -> None:
        self.bench.until(lambda: self.states()[-1:] == [state], f'the state {state.name}')


@pytest.fixture
def servo(bench):
    return Servo(bench)


@pytest.fixture
def node(bench, servo):
    return bench.start(served, **SERVED)


@pytest.fixture
def client(bench, node):
    made = Client(bench)
    yield made
    made.close()


def begun(servo, client, count=1):
    """Ask for docking, and return goal and result once the robot drives for it."""
    goal, result = client.ask()
    servo.started(count)
    servo.say(Phase.DISPLACING)
    client.sees(State.CONTROLLING)
    return goal, result


def test_it_docks_again_and_again(servo, client) -> None:
    for count in (1, 2, 3):
        client.feedback.clear()
        _, result = client.ask()
        servo.started(count)
        servo.say(Phase.DISPLACING)
        client.sees(State.CONTROLLING)
        servo.say(Phase.ARRIVED)
        assert client.outcome(result) == DOCKED
        assert client.states() == [2, 3]
    assert servo.calls == ['stop', 'start'] * 3


def test_a_failure_of_the_servo_is_the_error_with_its_reason(bench, servo, client) -> None:
    _, result = begun(servo, client)
    servo.say(Phase.FAILED, reason='the reason of the servo')
    assert client.outcome(result) == (ABORTED, [0, int(Error.FAILED_TO_CONTROL)])
    servo.stopped('stop', 'start', 'stop')
    assert bench.logged('dock_robot: the reason of the servo')


def test_a_cancel_stops_the_servo(servo, client) -> None:
    goal, result = begun(servo, client)
    goal.cancel_goal_async()
    assert client.outcome(result) == (CANCELED, [0, 0])
    servo.stopped('stop', 'start', 'stop')


def test_another_goal_aborts_the_first_and_docks(servo, client) -> None:
    _, first = begun(servo, client)
    _, second = client.ask()
    assert client.outcome(first)[0] == ABORTED
    servo.started(2)
    servo.say(Phase.DISPLACING, Phase.ARRIVED)
    assert client.outcome(second) == DOCKED


def test_what_cannot_be_served_and_a_servo_that_refuses_start_nothing(servo, client) -> None:
    _, result = client.ask(BY_POSE)
    assert client.outcome(result) == (ABORTED, [0, int(Error.DOCK_NOT_VALID)])
    servo.refuses = True
    _, result = client.ask()
    assert client.outcome(result) == GIVEN_UP
    assert 'start' not in servo.calls


def test_a_servo_that_is_not_there_is_an_unknown_error(bench) -> None:
    bench.start(served, **SERVED)
    client = Client(bench)
    _, result = client.ask()
    assert client.outcome(result) == GIVEN_UP
    assert bench.logged('service /servo_node/stop is not available')
    client.close()


@pytest.mark.parametrize('way', [('deactivate',), ('deactivate', 'cleanup'), ('shutdown',)])
def test_in_mid_docking_the_robot_is_stopped_and_the_goal_ends(
    bench, servo, node, client, way
) -> None:
    _, result = begun(servo, client)
    for label in way:
        assert change(bench, node, label=label)
    assert client.outcome(result) == GIVEN_UP
    servo.stopped('stop', 'start', 'stop')
    feedback = len(client.feedback)
    servo.say(Phase.DISPLACING)
    bench.settle()
    assert not client.send().accepted
    node.stop()  # as a signal does
    bench.settle()
    assert (len(servo.calls), len(client.feedback)) == (3, feedback)
    bench.until(lambda: bench.logged('dock_robot refused: /dock_node is '), 'the reason')


def test_active_again_it_docks_by_another_request_alone(bench, servo, node, client) -> None:
    begun(servo, client)
    go(bench, node, 'deactivate', 'activate')
    servo.stopped('stop', 'start', 'stop')
    _, result = begun(servo, client, 2)
    servo.say(Phase.ARRIVED)
    assert client.outcome(result) == DOCKED
    go(bench, node, 'deactivate')
    bench.settle()
    assert servo.calls[-1] == 'start'  # what has docked stays docked


def test_the_end_of_the_node_stops_the_servo(servo, node, client) -> None:
    begun(servo, client)
    node.stop()
    servo.stopped('stop', 'start', 'stop')


@pytest.mark.parametrize('cleanup', [False, True])
def test_a_servo_that_starts_after_the_end_is_stopped_again(
    bench, servo, node, client, cleanup
) -> None:
    def end() -> None:
        node.trigger_deactivate()  # which orders a stop; then comes the answer to the start
        if cleanup:
            node.trigger_cleanup()

    servo.on_start = end
    _, result = client.ask()
    assert client.outcome(result) == GIVEN_UP
    bench.until(lambda: servo.calls == ['stop', 'start', 'stop', 'stop'], 'both stops')


def test_configured_and_cleaned_up_again_and_again_it_leaves_nothing(bench) -> None:
    node = bench.start(served, **SERVED, autostart_node=False, mount_from_tf=True)
    assert_cycles_leave_nothing(bench, node)
    bench.until(lambda: not bench.probe.count_publishers('/detected_dock_pose'), 'its topics to')


def test_a_dock_node_that_is_destroyed_is_gone_at_once(bench) -> None:
    assert_gone_at_once(bench, bench.start(served, **SERVED))


def test_docking_outlives_all_that_it_hears(bench, servo, node, client) -> None:
    results = []

    def tell(rng, number: int) -> None:
        if number % 30 == 0:  # it supersedes what is under way
            results.append(client.ask()[1])
        fuzzing.sent_to(node, rng)
        bench.executor.spin_once(timeout_sec=0.0)

    fuzzing.assert_stays_small(tell, 8)
    bench.settle()
    go(bench, node, 'deactivate')
    bench.until(lambda: all(result.done() for result in results), 'an end of every goal')
    bench.settle()
    calls, rng = len(servo.calls), np.random.default_rng(9)
    for _ in range(fuzzing.COUNT):
        fuzzing.sent_to(node, rng)
    bench.settle()
    assert len(servo.calls) == calls
    go(bench, node, 'activate')
    _, result = client.ask()
    servo.started(servo.calls.count('start') + 1)
    servo.say(Phase.DISPLACING, Phase.ARRIVED)
    assert client.outcome(result)[1][0] == 1


HALF_WAY = -1.1


class Robot(Rig):
    """A base that obeys a real servo, its camera, and a client that asks it to dock."""

    goal = 7  # the number of the photograph

    def __init__(self, bench, **servo) -> None:
        self.poses, self.pose, self.blind = {}, Pose.from_start(0.2, -1.2, 4.0), False
        self.detected = bench.listen(PoseStamped, 'detected_dock_pose')
        self.odometry = bench.talk(Odometry, 'odom')
        super().__init__(bench, calibrated=False, autostart=False, **servo)
        bench.start(served, serve_action=True, servo_timeout=60.0)
        self.hear()
        self.client = Client(bench)
        self.step()  # or a start would be refused

    def ask(self):
        """Ask for docking, and wait until the servo has been started."""
        goal, result = self.client.ask()
        self.bench.until(lambda: self.words[-1].data == 'armed', 'the servo to be started')
        return goal, result

    def step(self) -> None:
        """Look, wait for what the servo does about it, and obey for one period."""
        heard, stamp_ns = len(self.commands), self.stamp_ns
        self.poses[stamp_ns] = self.pose
        self.odometry(write.odometry(self.pose, STANDSTILL, stamp_ns, 'odom', 'base_link'))
        frame = stamp_ns // PERIOD_NS
        self.show(NOTHING if self.blind else self.world.observe(self.pose, frame))
        if len(self.commands) > heard:
            self.pose = integrate(self.pose, self.twist, 1e-9 * PERIOD_NS)

    def drive_until(self, condition, most=1200) -> None:
        for _ in range(most):
            if condition():
                return
            self.step()
        pytest.fail(f'not after {most} images: phase {self.phase}')

    def outcome(self, result):
        self.drive_until(result.done)
        return self.client.outcome(result)


@pytest.fixture
def robot(bench):
    made = Robot(bench, holding_timeout=1.0)
    yield made
    made.client.close()


def test_it_docks_after_a_failed_request_and_detects_the_dock_on_the_way(robot) -> None:
    _, result = robot.ask()
    controls = lambda: robot.client.states()[-1:] == [State.CONTROLLING]  # noqa: E731
    robot.drive_until(lambda: controls() and robot.pose.y > HALF_WAY)
    robot.blind = True  # something stands before the camera until the servo gives up
    assert robot.outcome(result) == (ABORTED, [0, int(Error.FAILED_TO_DETECT_DOCK)])
    robot.blind = False
    _, result = robot.ask()
    assert robot.outcome(result) == DOCKED
    assert max(abs(robot.pose.x), abs(robot.pose.y)) < 0.005
    assert abs(robot.pose.heading_error) < math.radians(0.2)
    robot.bench.settle()
    errors = []
    for message in robot.detected:
        place, dock = message.pose.position, true_dock(robot.poses[read.stamp_ns(message.header)])
        errors.append(math.hypot(place.x - dock[0], place.y - dock[1]))
    assert len(errors) > 20
    assert max(errors) < 0.2  # four of the deviations at which it is published
    assert errors[-1] < 0.01
