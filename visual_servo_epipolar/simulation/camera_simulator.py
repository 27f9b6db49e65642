"""The simulated camera: a room seen from the robot, through an imperfect sensor."""

from dataclasses import dataclass, replace

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.disturbances.image import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, floor_jitter
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME, Sensor, SensorSettings
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rooms.scene import room


@dataclass(frozen=True, kw_only=True)
class CameraSettings(Settings):
    """
    The camera, where it sits, what it looks at; the defaults are a Lumenera LU175C.

    Its 4 mm lens and pixels of 5.2 um (assumed) make 769.23 px.
    """

    width: int = setting(1280, 'Image width [px]', low=16, high=8192, read_only=True)
    height: int = setting(1024, 'Image height [px]', low=16, high=8192, read_only=True)
    focal_length: float = setting(
        769.2307692307693, 'Focal length [px]', low=1.0, high=1e5, read_only=True
    )
    principal_u: float = setting(
        635.0, 'Principal point, from the left [px]', low=-1e4, high=1e4, read_only=True
    )
    principal_v: float = setting(
        512.0, 'Principal point, from the top [px]', low=-1e4, high=1e4, read_only=True
    )
    distortion: tuple[float, ...] = setting(
        (0.0, 0.0, 0.0, 0.0, 0.0), 'plumb_bob coefficients k1 k2 p1 p2 k3', read_only=True
    )
    frame_rate: float = setting(11.0, 'Frames a second [Hz]', low=0.1, high=200.0, read_only=True)
    encoding: str = setting(
        'mono8', 'Encoding of the images', choices=('mono8', 'bgr8'), read_only=True
    )
    scene: str = setting('room', 'What is seen', choices=('room', 'wall'), read_only=True)
    scene_seed: int = setting(1, 'Seed of the scene', low=0, high=2**31 - 1, read_only=True)
    seed: int = setting(0, 'Seed of noise and jitter', low=0, high=2**31 - 1, read_only=True)
    mount_height: float = setting(
        0.6, 'Height above the floor [m]', low=0.01, high=2.4, read_only=True
    )
    mount_forward: float = setting(
        0.0, 'Camera ahead of the axle [m]', low=-1.0, high=1.0, read_only=True
    )
    mount_left: float = setting(
        0.0, 'Camera to the left of the middle of the axle [m]', low=-1.0, high=1.0, read_only=True
    )
    tilt: float = setting(0.0, 'Tilt, down positive [rad]', low=-0.5, high=0.5, read_only=True)
    roll: float = setting(0.0, 'Roll, clockwise [rad]', low=-0.5, high=0.5, read_only=True)
    jitter: float = setting(
        0.0, 'Deviation of tilt and of roll by an uneven floor [rad]', low=0.0, high=0.1
    )
    noise: float = setting(
        2.0, 'Noise, standard deviation [grey levels]', low=0.0, high=50.0, read_only=True
    )
    gain_drift: float = setting(
        0.0, 'Amplitude of the drift of the gain', low=0.0, high=0.9, read_only=True
    )
    blur: float = setting(0.0, 'Blur, sigma [px]', low=0.0, high=10.0, read_only=True)
    believed_focal_ratio: float = setting(
        1.0, 'Focal length in camera_info over the true one', low=0.1, high=10.0, read_only=True
    )
    believed_shift_u: float = setting(
        0.0,
        'Principal point in camera_info, right of the true one [px]',
        low=-1e4,
        high=1e4,
        read_only=True,
    )
    believed_shift_v: float = setting(
        0.0,
        'Principal point in camera_info, below the true one [px]',
        low=-1e4,
        high=1e4,
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.camera  # raises ValueError for an impossible distortion

    @property
    def camera(self) -> Camera:
        """The true intrinsics, which images and points obey."""
        focal = self.focal_length
        return Camera(
            self.width,
            self.height,
            focal,
            focal,
            self.principal_u,
            self.principal_v,
            self.distortion,
        )

    @property
    def believed(self) -> Camera:
        """The intrinsics that tracker and servo are told: what calibration has made of them."""
        true = self.camera
        return replace(
            true,
            fx=self.believed_focal_ratio * true.fx,
            fy=self.believed_focal_ratio * true.fy,
            cx=true.cx + self.believed_shift_u,
            cy=true.cy + self.believed_shift_v,
        )

    @property
    def mount(self) -> CameraMount:
        """Where the camera sits."""
        return CameraMount(
            self.mount_height, self.mount_forward, self.tilt, self.roll, self.mount_left
        )


class CameraSimulator:
    """
    Takes images in a seeded room: the photograph from the goal, then frame after frame.

    ``disturbances`` come between the room and the sensor; the photograph is taken without them.
    """

    def __init__(
        self, settings: CameraSettings, disturbances: DisturbanceSettings | None = None
    ) -> None:
        self.settings = settings
        self.camera = settings.camera
        scene = room(settings.scene_seed, settings.scene)
        self.renderer = Renderer(scene, self.camera, settings.mount)
        sensor = SensorSettings(
            noise=settings.noise, gain_drift=settings.gain_drift, blur=settings.blur
        )
        self._sensor = Sensor((settings.width, settings.height), sensor, settings.seed)
        self.disturb(DisturbanceSettings() if disturbances is None else disturbances)

    def disturb(self, settings: DisturbanceSettings) -> None:
        """Let other things go wrong from now on."""
        size = self.settings.width, self.settings.height
        self._disturbances = Disturbances(size, settings, self.settings.seed)

    @property
    def disturbances(self) -> DisturbanceSettings:
        """What goes wrong."""
        return self._disturbances.settings

    def photograph(self) -> Image:
        """Return the desired image, taken from the goal."""
        return self.capture(DESIRED_POSE, DESIRED_FRAME)

    def capture(self, pose: Pose, frame: int) -> Image:
        """Return frame number ``frame``, shape (H, W), taken from ``pose``."""
        tilt, roll = floor_jitter(self.settings.jitter, self.settings.seed, frame)
        image = self.renderer.render(pose, tilt=tilt, roll=roll)
        if frame != DESIRED_FRAME:
            image = self._disturbances.apply(image, frame)
        return self._sensor.capture(image, frame)


class ImageView:
    """What the servo sees through camera and tracker; keeps the last image for pictures."""

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
