"""Inputs of a node that drives: its camera with the mount, and the driven path."""

from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import doubts
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import read, validation, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.commands import publishers
from visual_servo_epipolar.nodes.frames import StaticMount
from visual_servo_epipolar.nodes.startup.settings import DriverNodeSettings, RouteNodeSettings

NO_CAMERA = 'no usable camera_info yet; tracks wait for it, the robot stands'
DISTRUST_S = 2.0  # after a word of another camera: where two alternate, the robot stands


class ServoCamera:
    """
    The camera of the servo ``node``; ``warn`` logs its oddities.

    ``model`` is None until a camera_info comes that can be used. A run keeps to the camera that it
    began with, and to the mount.
    """

    def __init__(
        self, node: Node, settings: DriverNodeSettings, warn: Callable[[str], None]
    ) -> None:
        self.model: CameraModel | None = None
        self._unusable = ''  # why the last camera_info is not
        self.static_mount = StaticMount(
            node, settings.base_frame, warn, listens=settings.mount_from_tf
        )
        self._settings, self._warn = settings, warn
        self._other: tuple[CameraModel, int] | None = None  # heard in a run, and its stamp

    def hear(self, message: CameraInfo, run: Run, settings: ServoSettings) -> tuple[Run, str]:
        """Take in a camera_info; return the run, and why it cannot go on with it, or ''."""
        try:
            node = self._settings
            camera = read.camera(message, rectified=node.rectified, cropped=node.cropped)
        except ValueError as error:
            self.model, self._unusable = None, f'camera_info cannot be used: {error}'
            self._warn(f'camera_info cannot be used, the robot stands: {error}')
            return run, self._unusable
        self.model = camera
        self._doubt(camera, settings)
        run = run.with_camera(camera)
        trouble = run.other_camera(camera)
        if trouble:
            self._other = camera, read.stamp_ns(message.header)
        return run, trouble

    @property
    def missing(self) -> str:
        """Why there is no camera to drive by; or ''."""
        return '' if self.model is not None else self._unusable or NO_CAMERA

    def distrusted(self, stamp_ns: int, run: Run) -> str:
        """Return that another camera spoke up shortly before an image, in mid-run; or ''."""
        if self._other is None or not run.state.phase.runs:
            return ''
        camera, heard_ns = self._other
        recent = abs(seconds_between(heard_ns, stamp_ns)) <= DISTRUST_S
        return run.other_camera(camera) if recent and self.model == run.camera else ''

    def mounted(self, frame_id: str, state: ServoState, settings: ServoSettings) -> ServoSettings:
        """Return ``settings`` with the mount of /tf_static, before a run that was given none."""
        return settings if state.view.memory else self.static_mount.taken(frame_id, settings)

    def check(self, observation: Observation) -> None:
        """Warn where the lens cannot place tracks."""
        left_out = '' if self.model is None else validation.left_out(observation, self.model)
        if left_out:
            self._warn(left_out)

    def _doubt(self, camera: CameraModel, settings: ServoSettings) -> None:
        """Say what is odd about a camera."""
        if doubts(camera):
            self._warn(doubts(camera))
        if settings.focal_deviation > 0.0 and camera.planar is None:
            self._warn(
                f'focal_deviation is of a pinhole, the camera_info of a {camera.lens} lens: the '
                'corrections will be wrong; set focal_deviation: 0.0'
            )


class DrivenPath:
    """
    Path of the base of ``node``: by odometry, or by commands where its ``settings`` say so.

    What is wrong with it is logged by ``warn``; ``on_odometry`` is called when it grows by
    odometry, which may be ``ahead`` [s] older than an image. It is empty unless it ``listens``.
    ``base_frame`` is the one whose path odometry gives, '' before.
    """

    def __init__(
        self,
        node: Node,
        warn: Callable[[str], object],
        settings: RouteNodeSettings | None = None,
        on_odometry: Callable[[], None] = lambda: None,
        *,
        listens: bool = True,
        ahead: float = 0.0,
        profile: QoSProfile = qos.ODOMETRY,
    ) -> None:
        self._node, self._warn, self._on_odometry = node, warn, on_odometry
        self._listens, self.base_frame = listens, ''
        if settings is None or settings.path_source == 'odometry':
            self._topic, self._ahead = node.resolve_topic_name('odom'), ahead
            if listens:
                node.create_subscription(Odometry, 'odom', self._take_odometry, profile)
        else:  # it obeys the last command, and stands then
            self._topic, self._ahead = node.resolve_topic_name('cmd_vel'), math.inf
            kind = write.twist_type(stamped=settings.enable_stamped_cmd_vel)
            node.create_subscription(kind, 'cmd_vel', self._take_command, qos.COMMAND)
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget the path: what was driven since its end is not known."""
        self.path, self._epoch = Path(self._topic, ahead=self._ahead), 0

    def with_odometry(self, observation: Observation) -> Observation:
        """Return ``observation`` with where the base was, where that is known."""
        if not self._listens:
            return observation
        place = self.path.at(observation.stamp_ns)
        if place is None:
            self._warn(self.path.missing(observation.stamp_ns))
            return observation
        epoch, self._epoch = self._epoch, place.epoch
        if epoch != place.epoch:  # one image without: two poses are not of one frame
            return observation
        return replace(observation, odometry=Pose(*place.pose.tolist()))

    def _take_odometry(self, message: Odometry) -> None:
        try:
            stamp_ns, pose = read.stamp_ns(message.header), read.pose(message)
        except ValueError as error:
            self._warn(f'odometry refused: {error}')
            return
        self.base_frame = message.child_frame_id
        rupture = self.path.add_pose(stamp_ns, pose, message.header.frame_id)
        if rupture:
            names = ', '.join(sorted(publishers(self._node, self._topic).elements()))
            self.path.rupture = f'{rupture}; look at what publishes it: {names}'
            self._warn(self.path.rupture)
        self._on_odometry()

    def _take_command(self, message: Any) -> None:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        try:
            twist = read.twist(message)
        except ValueError as error:
            self._warn(f'a command is refused: {error}')
            return
        stamped = hasattr(message, 'header')
        self.path.add_twist(read.stamp_ns(message.header) if stamped else now_ns, twist)
