"""Docking on request without a robot: a servo that is counted, and who asks for docking."""

import itertools

from diagnostic_msgs.msg import DiagnosticArray
from dock_rig import Rig
from docking_drives import CAMERA
from fibonacci_wire import FibonacciWire
from geometry_msgs.msg import Twist as TwistMessage
from lifecycles import change
from rclpy.action import ActionClient
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

from visual_servo_epipolar.core.docking.task import State
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.messages import diagnostics, read, write
from visual_servo_epipolar.nodes.dock_node import DockNode

SERVED = {'serve_action': True, 'max_retries': 1}


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

    def say(self, phase, reason='') -> None:
        state = ServoState().changed(phase=phase, reason=reason)
        self._say(diagnostics.diagnosis(state, 1, name='/servo_node'))


class Client:
    """Who asks for docking."""

    def __init__(self, bench) -> None:
        self.bench = bench
        self._client = ActionClient(bench.probe, Fibonacci, 'dock_robot')
        self.feedback = []

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


def started(bench, servo, count=1):
    bench.until(lambda: servo.calls.count('start') == count, f'start {count} of the servo')
    bench.settle()


def drives(bench, servo, client, phase=Phase.DISPLACING):
    """Let the servo say a phase until the server has taken it in."""
    servo.say(phase)
    state = State.NAV_TO_STAGING_POSE if phase is Phase.RETREATING else State.CONTROLLING
    bench.until(lambda: client.feedback and client.feedback[-1][0] == state, f'state {state}')


class Led(Rig):
    """A dock node that is led about: it sees, is asked to dock, and turns commands round."""

    def __init__(self, bench, **values) -> None:
        self.servo = Servo(bench)
        self.twists = bench.listen(TwistMessage, 'cmd_vel')
        self._command = bench.talk(TwistMessage, 'cmd_vel_reversed')
        super().__init__(bench, served, **{**SERVED, 'camera_yaw': 3.14, **values})
        self.client = Client(bench)

    def command(self) -> None:
        """Command what the servo does that docks backward."""
        self._command(write.twist(Twist(0.3, 0.2)))
        self.bench.settle()

    def pass_by(self) -> None:
        """Drive past the photograph, whoever looks."""
        for _ in range(5):
            self.info(write.camera_info(CAMERA, 0, 'camera'))
            self.see()
            self.tell_odometry()
            self.command()
            self.advance()

    def docking(self):
        """Ask for docking, and return its result to come once the robot drives for it."""
        count = self.servo.calls.count('start')
        self.client.feedback.clear()
        _, result = self.client.ask()
        started(self.bench, self.servo, count + 1)
        drives(self.bench, self.servo, self.client)
        self.command()
        assert self.moving
        return result

    def lead(self, *labels) -> None:
        for label in labels:
            assert change(self.bench, self.node, label=label)

    def said(self) -> list[int]:
        """Return how much was said on each topic, and ordered."""
        heard = (self.poses, self.uncertain, self.reports, self.twists, self.servo.calls)
        return [len(item) for item in (*heard, self.client.feedback)]

    @property
    def moving(self) -> bool:
        return bool(self.twists) and read.twist(self.twists[-1]) != STANDSTILL
