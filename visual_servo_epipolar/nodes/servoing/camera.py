"""The camera of the servo: its camera_info, its mount, and warnings about both."""

from collections.abc import Callable

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import doubts
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import read, validation
from visual_servo_epipolar.nodes.frames import StaticMount
from visual_servo_epipolar.nodes.startup.settings import DriverNodeSettings

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
