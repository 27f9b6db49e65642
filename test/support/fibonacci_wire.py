"""An action that is at hand in place of DockRobot: numbers stand for its fields."""

from test_msgs.action import Fibonacci

from visual_servo_epipolar.core.docking.task import Outcome, Request, Task

BY_POSE = 99  # as order: a request that no photograph can serve


class FibonacciWire:
    """Feedback is the state and the retries, the result success, error and retries."""

    kind = Fibonacci

    def __init__(self) -> None:
        self.messages: list[str] = []  # of outcomes: there is no field for them

    def request(self, goal) -> Request:
        return Request(by_id=goal.order != BY_POSE)

    def feedback(self, task: Task, seconds: float):
        assert seconds >= 0.0
        return Fibonacci.Feedback(sequence=[int(task.state), task.retries])

    def result(self, task: Task, outcome: Outcome):
        self.messages.append(outcome.message)
        numbers = [int(outcome.success), int(outcome.error), task.retries]
        return Fibonacci.Result(sequence=numbers)
