"""Docking as messages: the action DockRobot of nav2_msgs, where it is installed."""

from importlib import import_module
from typing import Any

from builtin_interfaces.msg import Duration

from visual_servo_epipolar.core.docking.task import Outcome, State
from visual_servo_epipolar.core.stamps import NANOSECONDS


class DockRobotWire:
    """How requests, states and outcomes look in DockRobot of nav2_msgs, of Jazzy and later."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind

    def request(self, goal: Any) -> tuple[bool, str]:
        """Return whether a goal names a dock, and which; there is no staging pose to go to."""
        return bool(goal.use_dock_id), str(goal.dock_id)

    def feedback(self, state: State, seconds: float) -> Any:
        """Return the state of a request, which has taken ``seconds``, as feedback."""
        message = self.kind.Feedback()
        message.state = int(state)
        whole = round(seconds * NANOSECONDS)
        message.docking_time = Duration(sec=whole // NANOSECONDS, nanosec=whole % NANOSECONDS)
        return message

    def result(self, outcome: Outcome) -> Any:
        """Return the outcome of a request as result."""
        message = self.kind.Result()
        message.success, message.error_code = bool(outcome.success), int(outcome.error)
        if hasattr(message, 'error_msg'):  # the first releases of Jazzy have none
            message.error_msg = outcome.message
        return message


def dock_robot_wire() -> DockRobotWire | None:
    """Return the wire of nav2_msgs/action/DockRobot, None where it is not installed."""
    try:
        return DockRobotWire(import_module('nav2_msgs.action').DockRobot)
    except (ImportError, AttributeError):
        return None
