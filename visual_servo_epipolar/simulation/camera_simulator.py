"""Camera simulator: images of a room from the robot, through an imperfect sensor."""

from contextlib import AbstractContextManager, nullcontext
from functools import partial

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.simulation.disturbances.image import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME, Sensor, SensorSettings
from visual_servo_epipolar.simulation.rendering.assistant import Assistant
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rooms.scene import room
from visual_servo_epipolar.simulation.view import View

LARGEST_VIEW = 4  # of a lens that distorts, in images


class CameraSimulator:
    """
    Takes images in a seeded room: the photograph from the goal, then frame after frame.

    ``disturbances`` come between the room and the sensor; the photograph is taken without them.
    Settings may be replaced by others that differ in what is not read-only.
    """

    def __init__(
        self, settings: CameraSettings, disturbances: DisturbanceSettings | None = None
    ) -> None:
        self._settings, rig = settings, new_rig(settings)
        self.camera = rig.camera
        self.renderer = Renderer(room(settings.scene_seed, settings.scene), rig)
        sensor = SensorSettings(
            noise=settings.noise, gain_drift=settings.gain_drift, blur=settings.blur
        )
        self._sensor = Sensor((settings.width, settings.height), sensor, settings.seed)
        self._last: tuple[bytes, Image] | None = None
        self.disturb(DisturbanceSettings() if disturbances is None else disturbances)

    @property
    def settings(self) -> CameraSettings:
        """What the camera is like, and how much the floor shakes it."""
        return self._settings

    @settings.setter
    def settings(self, settings: CameraSettings) -> None:
        self._settings, self.renderer.rig = settings, new_rig(settings)

    def disturb(self, settings: DisturbanceSettings) -> None:
        """Disturb the images from now on as ``settings`` say."""
        size = self.settings.width, self.settings.height
        self._disturbances = Disturbances(size, settings, self.settings.seed)
        self._is_disturbed = settings != DisturbanceSettings()

    @property
    def disturbances(self) -> DisturbanceSettings:
        """The disturbances of the images."""
        return self._disturbances.settings

    def photograph(self) -> Image:
        """Return the desired image, shape (H, W), taken from the goal."""
        return self.capture(DESIRED_POSE, DESIRED_FRAME)

    def capture(self, pose: Pose, frame: int) -> Image:
        """Return frame number ``frame``, shape (H, W), taken from ``pose``."""
        image = self._render(pose, frame)
        if frame != DESIRED_FRAME and self._is_disturbed:
            image = self._disturbances.apply(image, frame)
        return self._sensor.capture(image, frame)

    def _render(self, pose: Pose, frame: int) -> Image:
        """Return the image before the sensor: the last one, read-only, of a camera that stands."""
        placed = self.renderer.rig.camera_pose(pose, frame)
        place = placed.centre.tobytes() + placed.R_world_camera.tobytes()
        if self._last is None or self._last[0] != place:
            image = self.renderer.render(pose, frame)
            image.setflags(write=False)
            self._last = place, image
        return self._last[1]


def assistant_of(settings: CameraSettings) -> AbstractContextManager[Assistant | None]:
    """
    Return a process that draws half of each image of such a camera; None without a second core.

    Where libraries with threads are still to be loaded, it is ready at once.
    """
    if cores() == 1:
        return nullcontext()
    build = partial(room, settings.scene_seed, settings.scene)
    return Assistant(build, LARGEST_VIEW * settings.width * settings.height)


class ImageView(View):
    """View through camera and tracker; keeps the last image for pictures."""

    def __init__(self, simulator: CameraSimulator, tracker: Tracker) -> None:
        self.simulator, self.tracker = simulator, tracker
        self.desired = simulator.photograph()
        self.image = self.desired
        self.features = Features()
        tracker.set_desired(self.desired)

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features seen from ``pose`` in frame number ``frame``."""
        self.image = self.simulator.capture(pose, frame)
        self.features = self.tracker.track(self.image)
        return self.features
