"""Head of the servo: angles of its joints in; angles at an image and commands out."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from visual_servo_epipolar.core.rigs.joint_history import HeadHistory
from visual_servo_epipolar.core.rigs.rig import Command, Rig
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.joints import COMMAND_TYPES, head_command, listed, read_joints
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings

MOST_OTHERS = 50  # joints that are named where one is missing


class Head:
    """
    The head that carries the camera of ``node``: it ``is_there`` if ``servo`` has such a rig.

    ``warn`` logs what is wrong with its messages. Without angles of an image no robot
    drives by it: a head that has turned looks as if the robot had.
    """

    def __init__(
        self,
        node: Node,
        servo: ServoSettings,
        settings: ServoNodeSettings,
        warn: Callable[[str], None],
    ) -> None:
        self._warn, self._speed = warn, servo.carrier.turn_rate
        self._limits = servo.pan_min, servo.pan_max
        self.is_there = self._speed > 0.0
        self._names = settings.pan_joint, settings.tilt_joint
        self._kind = settings.head_command
        self._topic = node.resolve_topic_name('joint_states')
        self.begin_anew()
        if self.is_there:
            profile = qos.ODOMETRY if settings.watchdog else qos.STREAM
            node.create_subscription(JointState, 'joint_states', self._take, profile)
            self._command_pub = node.create_publisher(
                COMMAND_TYPES[self._kind], 'head/command', qos.COMMAND
            )

    def begin_anew(self) -> None:
        """Forget where the joints were."""
        self._history = HeadHistory(self._names, self._speed, self._limits)
        self._others: dict[str, None] = {}  # names of joints, as long as some are missing
        self._refused = ''  # why a message could not be used

    def trouble(self, stamp_ns: int | None = None) -> str:
        """Return why the angles at an image, or any, are not known; or ''."""
        if not self.is_there:
            return ''
        missing = self._history.missing
        if missing and self._refused:
            return self._refused
        if missing:
            others = f' (it has {listed([*self._others])})' if self._others else ''
            more = ''.join(f', nor of {name}' for name in missing[1:])
            return (
                f'no angle of {missing[0]} on {self._topic}{more}{others}, a rig with a head '
                'needs those of its joints; start its driver, remap joint_states, or set '
                "pan_joint and tilt_joint to their names, tilt_joint: '' where there is no tilt"
            )
        return self._history.trouble(stamp_ns)

    def with_joints(self, observation: Observation, rig: Rig) -> Observation:
        """Return ``observation`` in axes of the base, by the angles at its image and the rig."""
        joints = self._history.at(observation.stamp_ns) if self.is_there else None
        return observation if joints is None else observation.on_rig(rig, joints)

    def send(self, command: Command, stamp_ns: int) -> None:
        """Publish what the head is to do; a ``command`` without leaves it as it is."""
        if command.head is not None and self.is_there:
            self._command_pub.publish(
                head_command(command.head, self._names, stamp_ns, kind=self._kind)
            )

    def _take(self, message: Any) -> None:
        try:
            angles = read_joints(message, self._names)
        except ValueError as error:
            self._refused = str(error)
            self._warn(self._refused)
            return
        odd = self._history.add(read.stamp_ns(message.header), angles)
        if odd:
            self._warn(odd)
        if self._history.missing and len(self._others) < MOST_OTHERS:
            self._others |= dict.fromkeys(message.name)
