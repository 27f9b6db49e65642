"""Simulated cameras: settings, a pan-tilt head with its encoders, a registry of rigs by name."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.cameras.equidistant import Equidistant, WIDEST
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, CAMERAS, with_intrinsics
from visual_servo_epipolar.core.rigs.rig import HeadCommand, Joints
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig
from visual_servo_epipolar.simulation.sensor import Receipt, Shutter


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
        0.0,
        'Share by which the focus changes the focal length, up and down in 2 s',
        low=0.0,
        high=0.2,
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
        'breathing_period': 2.0,
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

    def resized(self, width: int, height: int) -> 'CameraSettings':
        """Return the settings with the same lens and images of another size, pixels binned."""
        ratio_u, ratio_v = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            focal_length=ratio_u * self.focal_length,
            principal_u=ratio_u * (self.principal_u + 0.5) - 0.5,
            principal_v=ratio_v * (self.principal_v + 0.5) - 0.5,
        )

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
        return Shutter(self.readout, self.shutter, self.breathing, 2.0 * self.frame_rate)

    @property
    def receipt(self) -> Receipt:
        """When images are received, and stamped."""
        return Receipt(self.stamp_delay, self.stamp_jitter, self.seed, self.readout)

    def rig(self) -> SimulatedRig:
        """Return what carries the camera."""
        return SimulatedRig(self.camera, self.mount, self.jitter, self.seed, self.bumps)


RATE_S = 0.2  # for which a commanded rate holds
TILT_LIMIT, ACCELERATION = 0.6, 10.0  # of a joint: up or down [rad], [rad/s^2]


@dataclass(frozen=True, kw_only=True)
class HeadSettings(Settings):
    """A pan-tilt head and what is wrong with it; the defaults are a usual servo's."""

    head_pan_limit: float = setting(
        1.745, 'Largest pan angle to either side [rad]', low=0.0, high=6.2
    )
    head_speed: float = setting(2.0, 'Speed of a joint [rad/s]', low=0.01, high=50.0)
    head_delay: float = internal(0.05, 'Delay from command to motion [s]', low=0.0, high=1.0)
    head_encoder_noise: float = internal(
        3e-4, 'Deviation of an angle that is read [rad]', low=0.0, high=0.1
    )
    GONE: ClassVar[Mapping[str, Any]] = {
        'head_encoder_offset': 0.0,
        'head_start_pan': 0.0,
        'head_tilt_limit': 0.6,
        'head_acceleration': 10.0,
        'head_lever': 0.0,
    }


class SimulatedHead:
    """
    Head in simulated time [ns]: commands in; ``joints``, the true angles, and ``read`` ones out.

    It moves in ``advance`` alone. A command is an angle for each joint, which the head's own
    controller goes to at its speed and stops at; or, where angles are nan, a rate for RATE_S.
    """

    def __init__(self, settings: HeadSettings, *, seed: int, now_ns: int = 0) -> None:
        self.settings, self.now_ns, self._seed = settings, now_ns, seed
        self._angles, self._rates = [0.0, 0.0], [0.0, 0.0]
        self._goals = [0.0, 0.0]
        self._pending: deque[tuple[int, HeadCommand]] = deque()
        self._readings = 0

    @property
    def joints(self) -> Joints:
        """The true angles [rad]."""
        return Joints(*self._angles)

    def read(self) -> Joints:
        """Return what the encoders say, with the noise of this reading."""
        rng = np.random.default_rng((self._seed, 9, self._readings))
        self._readings += 1
        pan, tilt = (self.settings.head_encoder_noise * rng.standard_normal(2)).tolist()
        return Joints(self._angles[0] + pan, self._angles[1] + tilt)

    def command(self, command: HeadCommand | None) -> None:
        """Take ``command`` now; it counts after the delay; None leaves the one before."""
        if command is not None:
            delay_ns = round(self.settings.head_delay * NANOSECONDS)
            self._pending.append((self.now_ns + delay_ns, command))

    def advance(self, now_ns: int) -> None:
        """Move until ``now_ns`` [ns]."""
        while self.now_ns < now_ns:
            until_ns = min(self.now_ns + NANOSECONDS // 100, now_ns)
            while self._pending and self._pending[0][0] <= self.now_ns:
                self._obey(self._pending.popleft()[1])
            dt, self.now_ns = seconds_between(self.now_ns, until_ns), until_ns
            limits = self.settings.head_pan_limit, TILT_LIMIT
            for joint, limit in enumerate(limits):
                self._move(joint, min(max(self._goals[joint], -limit), limit), dt)

    def _obey(self, command: HeadCommand) -> None:
        """Take up a command that has arrived."""
        if math.isnan(command.pan):
            pan, tilt = self._angles
            self._goals = [pan + RATE_S * command.pan_rate, tilt + RATE_S * command.tilt_rate]
        else:
            self._goals = [command.pan, command.tilt]

    def _move(self, joint: int, goal: float, dt: float) -> None:
        """Move one joint towards ``goal`` for ``dt`` [s], so that it can stop there."""
        left, most = goal - self._angles[joint], ACCELERATION
        late = most * dt
        wanted = min(math.sqrt(late * late + 2.0 * most * abs(left)) - late, abs(left) / dt)
        wanted = math.copysign(min(wanted, self.settings.head_speed), left)
        rate = self._rates[joint]
        self._rates[joint] = rate + min(max(wanted - rate, -late), late)
        self._angles[joint] += self._rates[joint] * dt


@dataclass(frozen=True, kw_only=True)
class PanTiltSettings(HeadSettings, CameraSettings):
    """A camera that a head turns, and the head, with its pan axis at the mount."""

    def rig(self) -> SimulatedRig:
        """Return the head that carries the camera."""
        return replace(super().rig(), pan_limit=self.head_pan_limit)


# Settings of the camera on each rig, by its name; no two have a class in common.
SIMULATED_RIGS: dict[str, type[CameraSettings]] = {
    'fixed': CameraSettings,
    'pan_tilt': PanTiltSettings,
}


def head_settings(settings: CameraSettings) -> HeadSettings | None:
    """Return what the head is like that turns the camera; None of a rig without one."""
    return settings if isinstance(settings, HeadSettings) else None
