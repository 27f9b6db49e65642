"""Camera simulator: images of a room from the robot, through an imperfect sensor."""

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.bases import Nod
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.disturbances import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.light import (
    Exposure,
    Light,
    LIGHTS,
    LightSettings,
    UNCHANGED,
)
from visual_servo_epipolar.simulation.rendering.renderer import Exposures, Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rooms.scene import painted_room
from visual_servo_epipolar.simulation.sensor import (
    as_jpeg,
    CameraMotion,
    DESIRED_FRAME,
    Sensor,
    STILL,
)


class CameraSimulator:
    """
    Takes images in a seeded room: the photograph from the goal, then frame after frame.

    ``disturbances`` come between the room and the sensor; the photograph is taken without them.
    ``light`` says by which light each is taken, and at which exposure. Settings may be replaced by
    others that differ in what is not read-only.
    """

    def __init__(
        self,
        settings: CameraSettings,
        disturbances: DisturbanceSettings | None = None,
        light: LightSettings | None = None,
    ) -> None:
        self._settings, rig = settings, settings.rig()
        self.camera = rig.camera
        self._room = painted_room(settings.scene_seed, settings.scene)
        self.light = LightSettings() if light is None else light
        self._exposure = Exposure(self.light)
        scene = self._room.by(self._light_of_run.name, self.light.changed_by)
        self.renderer = Renderer(scene, rig)
        self._exposures = Exposures(self.renderer)
        self._size = settings.width, settings.height
        degrees = {'gain_drift': settings.gain_drift, 'blur': settings.blur}
        self._sensor = Sensor(self._size, settings.seed, noise=settings.noise, **degrees)
        self._last: tuple[tuple[object, ...], Scene, Image] | None = None
        self.disturb(DisturbanceSettings() if disturbances is None else disturbances)

    @property
    def settings(self) -> CameraSettings:
        """What the camera is like, and how much the floor shakes it."""
        return self._settings

    @settings.setter
    def settings(self, settings: CameraSettings) -> None:
        self._settings, self.renderer.rig = settings, settings.rig()

    def disturb(self, settings: DisturbanceSettings) -> None:
        """Disturb the images from now on as ``settings`` say."""
        self._disturbances = Disturbances(self._size, settings, self.settings.seed)
        self._is_disturbed = settings != DisturbanceSettings()

    def relight(self, settings: LightSettings) -> None:
        """Let the light be as ``settings`` say; an automatic exposure follows from where it is."""
        self.light = self._exposure.settings = settings

    def photograph(self) -> Image:
        """Return the desired image, shape (H, W), taken from the goal."""
        return self.capture(DESIRED_POSE, DESIRED_FRAME)

    def capture(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Image:
        """
        Return frame number ``frame``, shape (H, W), exposed from ``pose`` on during a ``motion``.

        Automatic exposure has settled on the photograph and on frame 0, and follows from there on.
        """
        if frame == DESIRED_FRAME:
            light, changed_by, gamma = LIGHTS[self.light.photograph_light], UNCHANGED, 1.0
        else:
            light, changed_by, gamma = self._light_of_run, self.light.changed_by, self.light.gamma
        self.renderer.scene = self._room.by(light.name, changed_by)
        image = self._render(pose, frame, motion)
        if frame != DESIRED_FRAME and self._is_disturbed:
            image = self._disturbances.apply(image, frame)
        if frame <= 0:
            self._exposure.begin()
        image, gain = self._exposure.take(image, light, gamma)
        image = self._sensor.capture(image, frame, gain)
        return as_jpeg(image, self.settings.jpeg) if self.settings.jpeg else image

    @property
    def _light_of_run(self) -> Light:
        return self.light.light_of(self.settings.seed)

    def _render(self, pose: Pose, frame: int, motion: CameraMotion) -> Image:
        """Return the image before the sensor: the last one, read-only, of a camera that stands."""
        shutter, scene = self._settings.row_timing, self.renderer.scene
        if shutter.is_instant:  # it shows the pitch alone
            motion = CameraMotion(nod=Nod(motion.nod.pitch), joints=motion.joints)
        axes, centre = self.renderer.rig.camera_pose(pose, frame, motion.joints)
        place = axes.tobytes(), centre.tobytes(), motion, shutter.zoom(frame)
        if self._last is None or self._last[0] != place or self._last[1] is not scene:
            image = self._exposures.render(pose, frame, motion, shutter)
            image.setflags(write=False)
            self._last = place, scene, image
        return self._last[2]


class ImageView:
    """View through camera and tracker; keeps the last image for pictures."""

    def __init__(self, simulator: CameraSimulator, tracker: Tracker) -> None:
        self.simulator, self.tracker = simulator, tracker
        self.desired = simulator.photograph()
        self.image = self.desired
        self.features = Features()
        tracker.set_desired(self.desired)

    def observe(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Features:
        """Return the features seen from ``pose`` in frame number ``frame``."""
        self.image = self.simulator.capture(pose, frame, motion)
        self.features = self.tracker.track(self.image)
        return self.features
