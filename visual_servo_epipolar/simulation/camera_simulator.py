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
    toned,
    UNCHANGED,
)
from visual_servo_epipolar.simulation.rendering.renderer import Exposures, Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rooms.scene import painted_room
from visual_servo_epipolar.simulation.sensor import (
    as_jpeg,
    DESIRED_FRAME,
    MAX_NOISE,
    Motion,
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
        scene = self._scene(self.light.light_of(settings.seed), has_changed=True)
        self.renderer = Renderer(scene, rig)
        self._exposures = Exposures(self.renderer)
        self._sensors: dict[float, Sensor] = {}  # by noise
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
        size = self.settings.width, self.settings.height
        self._disturbances = Disturbances(size, settings, self.settings.seed)
        self._is_disturbed = settings != DisturbanceSettings()

    def relight(self, settings: LightSettings) -> None:
        """Let the light be as ``settings`` say; an automatic exposure follows from where it is."""
        self.light = self._exposure.settings = settings

    def photograph(self) -> Image:
        """Return the desired image, shape (H, W), taken from the goal."""
        return self.capture(DESIRED_POSE, DESIRED_FRAME)

    def capture(self, pose: Pose, frame: int, motion: Motion = STILL) -> Image:
        """
        Return frame number ``frame``, shape (H, W), exposed from ``pose`` on during a ``motion``.

        Automatic exposure has settled on the photograph and on frame 0, and follows from there on.
        """
        is_photograph = frame == DESIRED_FRAME
        light = self._light_of(is_photograph)
        self.renderer.scene = self._scene(light, has_changed=not is_photograph)
        image = self._render(pose, frame, motion)
        if not is_photograph and self._is_disturbed:
            image = self._disturbances.apply(image, frame)
        if frame <= 0:
            self._exposure.begin()
        image, gain = self._exposure.take(image, light)
        image = toned(image, 1.0 if is_photograph else self.light.gamma)
        image = self._sensor(gain).capture(image, frame)
        return as_jpeg(image, self.settings.jpeg) if self.settings.jpeg else image

    def _light_of(self, is_photograph: bool) -> Light:
        if is_photograph:
            return LIGHTS[self.light.photograph_light]
        return self.light.light_of(self.settings.seed)

    def _scene(self, light: Light, *, has_changed: bool) -> Scene:
        return self._room.by(light.name, self.light.changed_by if has_changed else UNCHANGED)

    def _sensor(self, gain: float) -> Sensor:
        """Return the sensor at that gain, which its noise grows with."""
        settings, size = self.settings, (self.settings.width, self.settings.height)
        noise = min(gain * settings.noise, MAX_NOISE)
        if noise not in self._sensors:
            if len(self._sensors) == 4:  # kept, each for one noise
                del self._sensors[next(iter(self._sensors))]
            degrees = {'gain_drift': settings.gain_drift, 'blur': settings.blur}
            self._sensors[noise] = Sensor(size, settings.seed, noise=noise, **degrees)
        return self._sensors[noise]

    def _render(self, pose: Pose, frame: int, motion: Motion) -> Image:
        """Return the image before the sensor: the last one, read-only, of a camera that stands."""
        shutter, scene = self._settings.row_timing, self.renderer.scene
        if shutter.is_instant:  # it shows the pitch alone
            motion = Motion(nod=Nod(motion.nod.pitch), joints=motion.joints)
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

    def observe(self, pose: Pose, frame: int, motion: Motion = STILL) -> Features:
        """Return the features seen from ``pose`` in frame number ``frame``."""
        self.image = self.simulator.capture(pose, frame, motion)
        self.features = self.tracker.track(self.image)
        return self.features
