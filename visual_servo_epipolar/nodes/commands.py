"""Commands of a node that drives: to the base and to a head; others that command the same base."""

from collections import Counter
from collections.abc import Callable
import math
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState

from visual_servo_epipolar.core.errors import listed
from visual_servo_epipolar.core.rigs.joint_history import HeadHistory
from visual_servo_epipolar.core.rigs.rig import Command, Rig
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.joints import COMMAND_TYPES, head_command, read_joints
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.settings import DriverNodeSettings, ServoNodeSettings
from visual_servo_epipolar.nodes.steady import Stopwatch


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
        self._others: list[str] = []  # names of joints in the last message, where some are missing
        self._refused = ''  # why a message could not be used

    def trouble(self, stamp_ns: int | None = None) -> str:
        """Return why the angles at an image, or any, are not known; or ''."""
        if not self.is_there:
            return ''
        missing = self._history.missing
        if missing and self._refused:
            return self._refused
        if missing:
            others = f' (it has {listed(self._others)})' if self._others else ''
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
        if self._history.missing:
            self._others = list(message.name)


SETTLING_S = 1.0  # zero twists after the end of a run; then others may drive


class Commands:
    """
    Commands of a ``node`` that drives; outside of a run it is silent: others may drive.

    ``head`` is that which carries the camera, where one may.
    """

    def __init__(self, node: Node, settings: DriverNodeSettings, head: Head | None = None) -> None:
        self._head = head
        self._stamped, self._frame = settings.enable_stamped_cmd_vel, settings.base_frame
        self._always = not settings.watchdog
        # Since the run ended, was ended by somebody, and the last command went out.
        self._ended, self._stopped, self._sent = (Stopwatch(runs=False) for _ in range(3))
        kind = write.twist_type(stamped=self._stamped)
        self._command_pub = node.create_publisher(kind, 'cmd_vel', qos.COMMAND)

    def answer(self, before: ServoState, state: ServoState, stamp_ns: int) -> None:
        """Publish the command of ``state``, in a run and shortly after its end."""
        if not state.ended:
            self._ended.stop()
        elif not before.ended:
            self._ended.start()
        if self._always or self._ended.seconds <= SETTLING_S or state.phase.runs:
            self._stopped.stop()
            self.send(state.command, stamp_ns)

    def stopped(self) -> None:
        """Take note that somebody ended the run: no image will be answered by a zero twist."""
        self._stopped.start()

    def forget(self) -> None:
        """Repeat no order: an inactive node is silent."""
        self._stopped.stop()

    @property
    def repeats(self) -> bool:
        """Whether the order to stand is to be repeated: a message may get lost."""
        return self._stopped.seconds <= SETTLING_S

    @property
    def age(self) -> float:
        """Time since the last command went out [s]; nan where none did, or time waits for it."""
        return self._sent.seconds if self._sent.runs and not self._always else math.nan

    def send(self, command: Command, stamp_ns: int) -> None:
        """Publish ``command``: that to the head, then its twist on cmd_vel."""
        if self._head is not None:
            self._head.send(command, stamp_ns)
        self._sent.start()
        self._command_pub.publish(
            write.command(command.twist, stamp_ns, self._frame, stamped=self._stamped)
        )

    def wait(self) -> None:
        """Wait until the last command is acknowledged."""
        self._command_pub.wait_for_all_acked(qos.ACKNOWLEDGEMENT)


TOPIC = 'cmd_vel'


def conflict(node: Node) -> str:
    """Return that other servos publish on the cmd_vel of ``node``, and what to do; or ''."""
    own = Counter([node.get_fully_qualified_name()])
    topics, markers = dict(node.get_topic_names_and_types()), 'visualization_msgs/msg/MarkerArray'
    names = [it for it in publishers(node) - own if markers in topics.get(f'{it}/markers', [])]
    if not names:
        return ''
    return (
        f'{", ".join(sorted(names))} commands {node.resolve_topic_name(TOPIC)} as well, two '
        'servos would fight; end one, or give each a topic of its own and a multiplexer (one '
        'that was killed is gone after 20 s)'
    )


def publishers(node: Node, topic: str = TOPIC) -> Counter[str]:
    """Return the full names of publishers on a ``topic`` of ``node``, and how often."""
    infos = node.get_publishers_info_by_topic(topic)
    return Counter(f'{item.node_namespace.rstrip("/")}/{item.node_name}' for item in infos)
