"""The wheels of the base: odometry in, where they had the base at an image out."""

from collections.abc import Callable
from dataclasses import replace

from nav_msgs.msg import Odometry
from rclpy.node import Node

from visual_servo_epipolar.core.docking.path import (
    FASTEST,
    FASTEST_TURN,
    KEPT_S,
    LONGEST_STEP_S,
    Path,
)
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings

AHEAD_S = 0.1  # by which an image may be newer than odometry: the base goes on as it did
MEANWHILE = 'the servo goes by its commands meanwhile'


class Wheels:
    """
    Odometry of the base of ``node``, where ``settings`` ask for it.

    What is wrong with it is said by ``warn``. A message of it may be lost, but not where time
    itself waits for the servo (no watchdog).
    """

    def __init__(
        self,
        node: Node,
        settings: ServoSettings,
        node_settings: ServoNodeSettings,
        warn: Callable[[str], None],
    ) -> None:
        self._warn, self._listens = warn, settings.odometry
        self._topic = node.resolve_topic_name('odom')
        self.begin_anew()
        if self._listens:
            profile = qos.ODOMETRY if node_settings.watchdog else qos.STREAM
            node.create_subscription(Odometry, 'odom', self._take, profile)

    def begin_anew(self) -> None:
        """Forget where the base was."""
        self._path, self._frame, self._leapt = Path(command_timeout=AHEAD_S), '', False

    def with_odometry(self, observation: Observation) -> Observation:
        """Return ``observation`` with where the wheels had the base, where they tell."""
        if not self._listens:
            return observation
        return replace(observation, odometry=self._at(observation.stamp_ns))

    def _at(self, stamp_ns: int) -> Pose | None:
        place = None
        missing = self._missing(stamp_ns)
        if not missing:
            place = self._path.at(stamp_ns, predict=True)
            missing = '' if place else self._too_new(stamp_ns)
        if missing:
            self._warn(f'{missing}; {MEANWHILE}')
        if place is None or self._leapt:  # one image without: two poses are not of one frame
            self._leapt = self._leapt and place is None
            return None
        return Pose(*place.pose.tolist())

    def _missing(self, stamp_ns: int) -> str:
        last_ns = self._path.last_ns
        if last_ns is None:
            return (
                f'nothing usable came on {self._topic}, odometry: true expects nav_msgs/Odometry '
                'there; start what publishes it, or remap odom'
            )
        late = seconds_between(last_ns, stamp_ns)
        if late <= AHEAD_S:
            return ''
        return (
            f'odometry is {late:.2f} s older than the image, at most {AHEAD_S:g} s can be; look '
            'at its rate, and at the clocks of base and camera'
        )

    def _too_new(self, stamp_ns: int) -> str:
        return (
            f'odometry does not reach back to the image, expected {KEPT_S:g} s of it; look at the '
            'clocks of base and camera'
        )

    def _take(self, message: Odometry) -> None:
        try:
            stamp_ns, pose = read.stamp_ns(message.header), read.odometry(message)
        except ValueError as error:
            self._warn(f'odometry refused: {error}; {MEANWHILE}')
            return
        frame = message.header.frame_id
        if self._frame and frame != self._frame:
            self._warn(
                f'odometry is in the frame {frame}, was in {self._frame} before; let one alone '
                f'publish on {self._topic}; {MEANWHILE}'
            )
            self.begin_anew()
            self._leapt = True
        self._frame, epoch = frame, self._path.epoch
        self._path.add_pose(stamp_ns, pose)
        if self._path.epoch != epoch:
            self._leapt = True
            self._warn(
                f'odometry leaps, expected stamps that advance by less than {LONGEST_STEP_S:g} s '
                f'and motions below {FASTEST:g} m/s and {FASTEST_TURN:g} rad/s; look who resets '
                f'it, or else publishes on {self._topic}; {MEANWHILE}'
            )
