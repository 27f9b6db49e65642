"""Listener: a node in this process that hears what processes of nodes publish."""

from collections.abc import Callable
from contextlib import ExitStack
import time

import rclpy
from rclpy.node import Node

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.evaluation.live.processes import DOMAIN
from visual_servo_epipolar.nodes.isolated import isolated_context
from visual_servo_epipolar.nodes.startup.executor import MessageExecutor

START_S, LOOK_S = 60.0, 0.05


class Listener:
    """Hears what others on this machine publish, until ``stack`` ends."""

    def __init__(self, stack: ExitStack, name: str) -> None:
        context = stack.enter_context(isolated_context('LOCALHOST', domain_id=DOMAIN))
        self.node: Node = rclpy.create_node(name, context=context)
        stack.callback(self.node.destroy_node)
        # rclpy's own would be felt in what it times.
        self._executor = MessageExecutor(context=context)
        self._executor.add_node(self.node)

    def spin_for(self, seconds: float) -> None:
        """Hear what comes for ``seconds`` [s]."""
        self._spin_until(time.monotonic() + seconds)

    def wait(
        self, condition: Callable[[], bool], complaint: str, timeout_s: float = START_S
    ) -> None:
        """Hear what comes until ``condition``, or raise ``complaint`` after a while."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            self.spin_for(LOOK_S)
            if time.monotonic() > deadline:
                raise VisualServoError(f'{complaint} within {timeout_s:g} s')

    def _spin_until(self, moment: float) -> None:
        while (remaining := moment - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=remaining)
