"""Settings of the simulated camera: lens and image, mount, scene, noise."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, ClassVar

from visual_servo_epipolar.core.cameras.equidistant import Equidistant, WIDEST
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, CAMERAS, with_intrinsics
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.mounts.sensor import Receipt, Shutter


@dataclass(frozen=True, kw_only=True)
class CameraSettings(Settings):
    """
    The camera, where it sits, what it looks at; the defaults are a Lumenera LU175C.

    Its 4 mm lens and pixels of 5.2 um (assumed) make 769.23 px.
    """

    width: int = fixed(1280, 'Image width [px]', low=16, high=8192)
    height: int = fixed(1024, 'Image height [px]', low=16, high=8192)
    focal_length: float = fixed(769.2307692307693, 'Focal length [px]', low=1.0, high=1e5)
    principal_u: float = fixed(635.0, 'Principal point, from the left [px]', low=-1e4, high=1e4)
    principal_v: float = fixed(512.0, 'Principal point, from the top [px]', low=-1e4, high=1e4)
    distortion: tuple[float, ...] = fixed(
        (0.0, 0.0, 0.0, 0.0, 0.0),
        'Coefficients of the lens, as in camera_info; zeros are none, of any model',
    )
    distortion_model: str = fixed(
        'plumb_bob',
        'Lens: plumb_bob, rational_polynomial, equidistant (a fisheye, whose focal length is that '
        'of its centre), equirectangular (360 deg, given by the size alone), or one of another '
        'package',
    )
    image_circle: float = fixed(
        360.0,
        'Full angle that an equidistant lens shows, dark beyond; camera_info does not tell [deg]',
        low=10.0,
        high=360.0,
    )
    frame_rate: float = fixed(11.0, 'Frames a second [Hz]', low=0.1, high=200.0)
    encoding: str = fixed('mono8', 'Encoding of the images', choices=('mono8', 'bgr8'))
    scene: str = fixed(
        'room',
        'What is seen',
        choices=('room', 'wall', 'plain', 'storey', 'nearwall', 'nearwall_boxes'),
    )
    scene_seed: int = internal(1, 'Seed of the scene', low=0, high=2**31 - 1)
    seed: int = fixed(0, 'Seed of noise and jitter', low=0, high=2**31 - 1)
    mount_height: float = fixed(0.6, 'Height above the floor [m]', low=0.01, high=2.4)
    mount_forward: float = fixed(0.0, 'Camera ahead of the axle [m]', low=-1.0, high=1.0)
    mount_left: float = fixed(
        0.0, 'Camera to the left of the middle of the axle [m]', low=-1.0, high=1.0
    )
    mount_yaw: float = fixed(0.0, 'Yaw, to the left seen from above [rad]', low=-0.8, high=0.8)
    tilt: float = fixed(0.0, 'Tilt, down positive [rad]', low=-0.8, high=0.8)
    roll: float = fixed(0.0, 'Roll, clockwise [rad]', low=-0.5, high=0.5)
    jitter: float = setting(
        0.0, 'Deviation of tilt and of roll by an uneven floor [rad]', low=0.0, high=0.1
    )
    bumps: float = internal(
        0.0,
        'Height of the bumps of the floor, 1.2 to 2.4 m long and each in its place: 5 mm lean the '
        'robot by up to 1 to 1.5 deg [m]',
        low=0.0,
        high=0.05,
    )
    noise: float = fixed(2.0, 'Noise, standard deviation [grey levels]', low=0.0, high=50.0)
    gain_drift: float = internal(0.0, 'Amplitude of the drift of the gain', low=0.0, high=0.9)
    blur: float = fixed(0.0, 'Blur, sigma [px]', low=0.0, high=10.0)
    jpeg: int = internal(
        0, 'Quality of the JPEG that images come as; 0 = as they are', low=0, high=100
    )
    shutter: float = setting(
        0.0,
        'Time that a row is exposed: motion blurs it, and light that flickers is averaged; '
        '0 = an instant [s]',
        low=0.0,
        high=1.0,
    )
    readout: float = setting(
        0.0,
        'Rolling shutter: time from the first row, exposed at the stamp, to the last; '
        '0 = global shutter [s]',
        low=0.0,
        high=0.1,
    )
    breathing: float = internal(
        0.0, 'Share by which the focus changes the focal length, up and down', low=0.0, high=0.2
    )
    breathing_period: float = internal(
        2.0, 'Period of that change of the focal length [s]', low=0.1, high=100.0
    )
    stamp_delay: float = internal(
        0.0,
        'Time from the exposure to the receipt, when the image is stamped; 0 = stamped as exposed '
        '[s]',
        low=0.0,
        high=1.0,
    )
    stamp_jitter: float = internal(0.0, 'Standard deviation of that time [s]', low=0.0, high=0.2)
    believed_focal_ratio: float = internal(
        1.0, 'Focal length in camera_info over the true one', low=0.1, high=10.0
    )
    believed_shift_u: float = internal(
        0.0, 'Principal point in camera_info, right of the true one [px]', low=-1e4, high=1e4
    )
    believed_shift_v: float = internal(
        0.0, 'Principal point in camera_info, below the true one [px]', low=-1e4, high=1e4
    )
    GONE: ClassVar[Mapping[str, Any]] = {
        'lens_baseline': 0.1,
        'lens_rotation': (0.0, 0.0, 0.0),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.camera  # raises ValueError for an impossible distortion

    @property
    def camera(self) -> CameraModel:
        """The true intrinsics, which images and points obey."""
        focal = self.focal_length
        k = (focal, 0.0, self.principal_u, 0.0, focal, self.principal_v, 0.0, 0.0, 1.0)
        plumb_bob = self.distortion_model == 'plumb_bob'
        # The zeros that stand for no distortion are as many as plumb_bob has.
        distortion = self.distortion if plumb_bob or any(self.distortion) else ()
        camera = calibrated_camera((self.width, self.height), k, distortion, self.distortion_model)
        if isinstance(camera, Equidistant):
            return replace(camera, circle=min(math.radians(0.5 * self.image_circle), WIDEST))
        return camera

    @property
    def nominal_camera(self) -> CameraModel:
        """The nominal intrinsics, those of the calibration, by which tracker and servo go."""
        true = self.camera
        if CAMERAS[true.distortion_model].of_size is not None:
            return true
        return with_intrinsics(
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
            height=self.mount_height,
            forward=self.mount_forward,
            tilt=self.tilt,
            roll=self.roll,
            left=self.mount_left,
            yaw=self.mount_yaw,
        )

    @property
    def row_timing(self) -> Shutter:
        """When rows are exposed, and by which focal length."""
        period = self.breathing_period * self.frame_rate
        return Shutter(self.readout, self.shutter, self.breathing, period)

    @property
    def receipt(self) -> Receipt:
        """When images are received, and stamped."""
        return Receipt(self.stamp_delay, self.stamp_jitter, self.seed, self.readout)

    def fixed_rig(self) -> FixedRig:
        """Return the rig of a camera that is screwed to the robot."""
        return FixedRig(self.camera, self.mount, self.jitter, self.seed, self.bumps)
