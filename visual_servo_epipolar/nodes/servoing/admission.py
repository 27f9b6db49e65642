"""Admission: which tracks the servo drives by, and why not by others."""

from collections.abc import Callable

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from visual_servo_epipolar.core.control.command import HALT
from visual_servo_epipolar.core.servo.interruptions import GOAL_CHANGED, RunGoal
from visual_servo_epipolar.core.servo.phases.table import RUNNING
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes.servoing import stamps
from visual_servo_epipolar.nodes.servoing.rivals import Rivals
from visual_servo_epipolar.nodes.servoing.run import Run
from visual_servo_epipolar.nodes.servoing.still_view import StillView
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings


class Admission:
    """
    Admission of tracks to the ``run`` of the servo ``node``.

    ``settings`` returns those in force. Where time itself waits for the servo (no watchdog), all
    tracks are timely.
    """

    def __init__(
        self,
        node: Node,
        settings: Callable[[], ServoNodeSettings],
        run: Run,
        rivals: Rivals,
    ) -> None:
        self._node, self._settings, self._run, self._rivals = node, settings, run, rivals
        self._goal, self._still = RunGoal(), StillView()

    def refusal(self, message: PointCloud2, still_timeout: float) -> str:
        """
        Return why no step is taken by these tracks, or ''.

        Too old, not newer than others of the run, or the very same for ``still_timeout`` [s] of
        driving.
        """
        if not self._settings().watchdog:
            return ''
        stamp_ns, run = read.stamp_ns(message.header), self._run
        now_ns = self._node.get_clock().now().nanoseconds
        newest_ns = run.stamp_ns if run.state.phase in RUNNING else None
        trouble = stamps.refusal(stamp_ns, now_ns, self._settings().max_latency)
        trouble = trouble or stamps.disorder(newest_ns, stamp_ns)
        if trouble:
            return trouble
        self._still.look(message, told_to_drive=run.state.command != HALT)
        return self._still.trouble(still_timeout) if newest_ns is not None else ''

    def contested(self) -> str:
        """Return that another servo commands the same base, so that no run may begin; or ''."""
        if not self._settings().watchdog:
            return ''
        return self._rivals.refusal()

    def other_goal(self, message: PointCloud2) -> str:
        """Return that the photograph is not the one that the run began with; or ''."""
        other = self._goal.is_other(read.goal(message), self._run.state)
        return GOAL_CHANGED if other else ''
