"""An action that is at hand in place of DockRobot: numbers stand for its fields."""

from test_msgs.action import Fibonacci

from visual_servo_epipolar.core.docking.task import Outcome, State

BY_POSE = 99  # as order: a request that no photograph can serve


class FibonacciWire:
    """Feedback is the state, the result success and error."""

    kind = Fibonacci

    def request(self, goal) -> tuple[bool, str]:
        return goal.order != BY_POSE, ''

    def feedback(self, state: State, seconds: float):
        assert seconds >= 0.0
        return Fibonacci.Feedback(sequence=[int(state)])

    def result(self, outcome: Outcome):
        return Fibonacci.Result(sequence=[int(outcome.success), int(outcome.error)])
