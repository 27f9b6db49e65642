"""Camera simulator: images of a room from the robot, through an imperfect sensor."""

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.bases import LEVEL, Nod
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import View
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
    Sensor,
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
        self._joints: Joints | None = None  # as long as no head has turned it
        self.camera = rig.camera
        self._room = painted_room(settings.scene_seed, settings.scene)
        self.light = LightSettings() if light is None else light
        self._exposure = Exposure(self.light)
        scene = self._scene(self.light.light_of(settings.seed), has_changed=True)
        self.renderer = Renderer(scene, rig)
        self._exposures = Exposures(self.renderer)
        self._twist, self._nod = STANDSTILL, LEVEL
        self._sensors: dict[float, Sensor] = {}  # by noise
        self._last: tuple[tuple[object, ...], Scene, Image] | None = None
        self.disturb(DisturbanceSettings() if disturbances is None else disturbances)

    @property
    def settings(self) -> CameraSettings:
        """What the camera is like, and how much the floor shakes it."""
        return self._settings

    @settings.setter
    def settings(self, settings: CameraSettings) -> None:
        rig = settings.rig()
        self._settings = settings
        self.renderer.rig = rig if self._joints is None else rig.turned(self._joints)

    def turn(self, joints: Joints) -> None:
        """Let the head that carries the camera have its joints at these angles from now on."""
        self._joints, self.renderer.rig = joints, self.renderer.rig.turned(joints)

    def move(self, twist: Twist, nod: Nod = LEVEL) -> None:
        """Let base and body move so from now on; an instant shows the pitch alone."""
        self._twist, self._nod = twist, nod

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

    def capture(self, pose: Pose, frame: int) -> Image:
        """
        Return frame number ``frame``, shape (H, W), taken from ``pose``.

        Automatic exposure has settled on the photograph and on frame 0, and follows from there on.
        """
        is_photograph = frame == DESIRED_FRAME
        light = self._light_of(is_photograph)
        self.renderer.scene = self._scene(light, has_changed=not is_photograph)
        image = self._render(pose, frame)
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

    def _render(self, pose: Pose, frame: int) -> Image:
        """Return the image before the sensor: the last one, read-only, of a camera that stands."""
        placed, shutter = self.renderer.rig.camera_pose(pose, frame), self._settings.row_timing
        moves = frame != DESIRED_FRAME and not shutter.is_instant
        twist, scene = self._twist if moves else STANDSTILL, self.renderer.scene
        nod = LEVEL if frame == DESIRED_FRAME else self._nod
        nod = nod if moves else Nod(nod.pitch)
        axes, centre = placed.R_world_camera.tobytes(), placed.centre.tobytes()
        place = axes, centre, twist, nod, shutter.zoom(frame)
        if self._last is None or self._last[0] != place or self._last[1] is not scene:
            image = self._exposures.render(pose, frame, twist, shutter, nod)
            image.setflags(write=False)
            self._last = place, scene, image
        return self._last[2]


class ImageView(View):
    """View through camera and tracker; keeps the last image for pictures."""

    def __init__(self, simulator: CameraSimulator, tracker: Tracker) -> None:
        self.simulator, self.tracker = simulator, tracker
        self.desired = simulator.photograph()
        self.image = self.desired
        self.features = Features()
        tracker.set_desired(self.desired)

    def turn(self, joints: Joints) -> None:
        """Let the head have its joints at these angles."""
        self.simulator.turn(joints)

    def move(self, twist: Twist, nod: Nod = LEVEL) -> None:
        """Let base and body move so while rows are exposed."""
        self.simulator.move(twist, nod)

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features seen from ``pose`` in frame number ``frame``."""
        self.image = self.simulator.capture(pose, frame)
        self.features = self.tracker.track(self.image)
        return self.features
