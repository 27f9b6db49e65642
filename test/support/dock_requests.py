"""Docking on request without a robot: a servo that is counted, and a client that asks for it."""

import itertools

from diagnostic_msgs.msg import DiagnosticArray
from fibonacci_wire import FibonacciWire
from rclpy.action import ActionClient
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

from visual_servo_epipolar.core.docking.task import State
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.messages import diagnostics
from visual_servo_epipolar.nodes.dock_node import DockNode

SERVED = {'serve_action': True}


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
