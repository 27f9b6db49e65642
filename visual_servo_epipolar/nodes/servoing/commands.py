"""Commands of a node that drives: twists on cmd_vel while a run goes on, then silence."""

import math

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servoing.head import Head
from visual_servo_epipolar.nodes.startup.settings import DriverNodeSettings

SETTLING_S = 1.0  # zero twists after the end of a run; then others may drive


class Commands:
    """
    Commands of a ``node`` that drives; outside of a run it is silent: others may drive.

    ``head`` is that which carries the camera, where one may. A base that steers is sent
    ackermann_msgs on ackermann_cmd, too, where these are installed.
    """

    def __init__(
        self, node: Node, settings: DriverNodeSettings, servo: ServoSettings, head: Head | None
    ) -> None:
        self._head, self._wheelbase = head, servo.wheelbase
        self._stamped, self._frame = settings.enable_stamped_cmd_vel, settings.base_frame
        self._always, self._steady = not settings.watchdog, Clock(clock_type=ClockType.STEADY_TIME)
        self._ended_ns: int | None = None  # when the run ended
        self._stopped_ns: int | None = None  # when somebody ended it
        self._sent_ns: int | None = None  # when the last command went out
        kind = write.twist_type(stamped=self._stamped)
        self._command_pub = node.create_publisher(kind, 'cmd_vel', qos.COMMAND)
        self._drive = None if turns_in_place(servo.drive) else write.ackermann_type()
        if self._drive is not None:
            self._drive_pub = node.create_publisher(self._drive, 'ackermann_cmd', qos.COMMAND)

    def answer(self, before: ServoState, state: ServoState, stamp_ns: int) -> None:
        """Publish the command of ``state``, in a run and shortly after its end."""
        now_ns = self._steady.now().nanoseconds
        if not state.ended:
            self._ended_ns = None
        elif not before.ended:
            self._ended_ns = now_ns
        if self._always or _just_now(self._ended_ns, now_ns) or state.phase.runs:
            self._stopped_ns = None
            self.send(state.command, stamp_ns)

    def stopped(self) -> None:
        """Take note that somebody ended the run: no image will be answered by a zero twist."""
        self._stopped_ns = self._steady.now().nanoseconds

    def forget(self) -> None:
        """Repeat no order: an inactive node is silent."""
        self._stopped_ns = None

    @property
    def repeats(self) -> bool:
        """Whether the order to stand is to be repeated: a message may get lost."""
        return _just_now(self._stopped_ns, self._steady.now().nanoseconds)

    @property
    def age(self) -> float:
        """Time since the last command went out [s]; nan where none did, or time waits for it."""
        if self._always or self._sent_ns is None:
            return math.nan
        return seconds_between(self._sent_ns, self._steady.now().nanoseconds)

    def send(self, command: Command, stamp_ns: int) -> None:
        """Publish ``command``: that to the head, then its twist on cmd_vel."""
        if self._head is not None:
            self._head.send(command, stamp_ns)
        self._sent_ns = self._steady.now().nanoseconds
        if self._drive is not None:
            self._drive_pub.publish(
                write.ackermann_drive(
                    self._drive, command.twist, self._wheelbase, stamp_ns, self._frame
                )
            )
        self._command_pub.publish(
            write.command(command.twist, stamp_ns, self._frame, stamped=self._stamped)
        )

    def wait(self) -> None:
        """Wait until the last command is acknowledged."""
        self._command_pub.wait_for_all_acked(qos.ACKNOWLEDGEMENT)


def _just_now(then_ns: int | None, now_ns: int) -> bool:
    """Return whether what ended at ``then_ns``, if it did, ended just now."""
    return then_ns is not None and seconds_between(then_ns, now_ns) <= SETTLING_S
