"""Settings of the servo: bounds at which phases end, timeouts, and those of both layers below."""

from dataclasses import astuple, dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from visual_servo_epipolar.core.laws.settings import ControlSettings
from visual_servo_epipolar.core.perception.settings import PerceptionSettings
from visual_servo_epipolar.core.rigs.fixed_mount import Mount
from visual_servo_epipolar.core.rigs.registry import DEFAULT_RIG, rig_of
from visual_servo_epipolar.core.rigs.rig import HeadLimits, Joints, Rig
from visual_servo_epipolar.core.servo.identification.extrinsics import (
    configured_extrinsics,
    Extrinsics,
)
from visual_servo_epipolar.core.settings import fixed, internal, setting

LEAST_EXCURSION = 1.05  # start distances: below it noise alone would fail the run
MOUNT = tuple(f'camera_{item.name}' for item in fields(Mount))


@dataclass(frozen=True, kw_only=True)
class ServoSettings(PerceptionSettings, ControlSettings):
    """
    Settings of the servo: those of perception and control, and its own, in one flat list.

    Angles in rad, lengths in m, times in s; epipoles in units of the focal length.
    """

    rig: str = fixed(
        DEFAULT_RIG,
        'What carries the camera: fixed (a mount), pan_tilt (a head), or one of another package',
    )
    pan_min: float = fixed(-1.745, 'Head: least pan angle [rad]', low=-6.2, high=0.0)
    pan_max: float = fixed(1.745, 'Head: largest pan angle, to the left [rad]', low=0.0, high=6.2)
    pan_speed: float = fixed(1.5, 'Head: speed of its pan joint [rad/s]', low=0.01, high=20.0)
    head_latency: float = fixed(
        0.1, 'Head: time from its command to its motion [s]', low=0.0, high=1.0
    )
    photograph_pan: float = fixed(
        0.0, 'Head: pan angle at which the photograph was taken [rad]', low=-6.2, high=6.2
    )
    photograph_tilt: float = fixed(
        0.0,
        'Head: tilt angle at which the photograph was taken, and which it keeps [rad]',
        low=-1.5,
        high=1.5,
    )
    camera_yaw: float = fixed(
        0.0, 'Yaw of the camera on the base, to the left, as configured [rad]', low=-1.6, high=1.6
    )
    camera_forward: float = fixed(
        0.0, 'Camera ahead of the axle, as configured [m]', low=-2.0, high=2.0
    )
    camera_left: float = fixed(
        0.0, 'Camera to the left of the middle of the axle, as configured [m]', low=-2.0, high=2.0
    )
    camera_yaw_deviation: float = fixed(
        0.09, 'Deviation of that yaw, estimated while driving [rad]', low=0.0, high=0.5
    )
    camera_forward_deviation: float = fixed(
        0.15, 'Deviation of that offset ahead, estimated while driving [m]', low=0.0, high=1.0
    )
    camera_left_deviation: float = fixed(
        0.07, 'Deviation of that offset aside, estimated while driving [m]', low=0.0, high=1.0
    )
    odometry: bool = fixed(
        False,
        'Use odom instead of commands for the motion between images, unless images contradict it',
    )
    autostart: bool = fixed(False, 'Start by itself once there are tracks; false: on ~/start')
    latch_engage: float = setting(
        0.002, 'Step 1: bearing of e_du that counts as zero [rad]', low=0.0, high=0.2
    )
    latch_release: float = internal(
        0.007, 'Step 1: bearing of e_du at which it has escaped again [rad]', low=0.0, high=0.5
    )
    align_tolerance: float = internal(
        0.0015, 'Step 1: bearing of e_au at which it ends [rad]', low=1e-5, high=0.1
    )
    align_frames: int = internal(
        3, 'Step 1: frames in a row that must be aligned at its end', low=1, high=100
    )
    arrival_difference: float = internal(
        1e-4, '|D| at unit focal length below which the features match', low=1e-8, high=0.1
    )
    arrival_position: float = setting(
        0.0,
        'Position error within which it has arrived; 0 = as precisely as possible [m]',
        low=0.0,
        high=0.5,
    )
    arrival_heading: float = setting(
        6e-4,
        'Heading error within which it faces the goal; 0.0006 or less = as precisely as '
        'possible [rad]',
        low=1e-5,
        high=0.1,
    )
    arrival_parallax: float = internal(
        1.5e-4,
        'Parallax beyond noise above which the robot is not at the goal [rad]',
        low=0,
        high=1,
    )
    arrival_frames: int = internal(5, 'Frames in a row that must match', low=1, high=100)
    near_parallax: float = internal(
        0.02, 'Parallax below which a goal without trusted bearings is near [rad]', low=0, high=1
    )
    sideways_bearing: float = internal(
        0.6,
        'Retreat: bearing of e_du above which the robot backs off first [rad]',
        low=0,
        high=1.6,
    )
    retreat_bearing: float = internal(
        0.5, 'Bearing of e_du at which backing off ends [rad]', low=0.01, high=1.5
    )
    retreat_heading: float = internal(
        0.1, 'Heading error above which the robot turns before it backs off [rad]', low=0, high=1
    )
    retreat_difference: float = internal(
        0.06, '|D| at unit focal length to back off to at least', low=0.001, high=1.0
    )
    retreat_speed: float = setting(0.2, 'Speed of backing off [m/s]', low=0.01, high=2.0)
    max_retreat: float = setting(
        20.0,
        'Largest distance driven backward in a run, all attempts together; 0 = it never backs '
        'off [m]',
        low=0.0,
        high=100.0,
    )
    max_excursion: float = setting(
        1.3,
        'Largest distance from the goal in steps 1 and 2, relative to their start; 0 = off',
        low=0,
        high=10,
    )
    divergence: float = internal(
        1.5, 'Bearing of e_du at which step 1 has failed [rad]', low=0.5, high=1.57
    )
    phase_timeout: float = setting(120.0, 'Longest stay in one phase [s]', low=1.0, high=3600.0)
    run_timeout: float = setting(600.0, 'Longest run [s]', low=1.0, high=86400.0)
    holding_timeout: float = setting(
        5.0, 'Longest hold before the run fails [s]', low=0.1, high=600.0
    )
    few_features_timeout: float = setting(
        15.0,
        'Longest drive on the memory of views alone, with fewer than min_features; 0 = none [s]',
        low=0.0,
        high=600.0,
    )
    stale_timeout: float = setting(
        0.5, 'Age of the last tracks at which the robot is stopped [s]', low=0.05, high=60.0
    )
    max_attempts: int = setting(5, 'Attempts before a miss is a failure', low=1, high=20)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.carrier.turn_rate > 0.0 and not self.calibrated:  # or for an unknown rig
            raise ValueError(
                f'focal_deviation must be 0 with rig {self.rig}, got {self.focal_deviation:g}: '
                'an unknown lens looks like joints that turn; calibrate the camera'
            )
        if self.latch_engage > self.latch_release:
            raise ValueError(
                f'latch_engage must not exceed latch_release, got {self.latch_engage:g} and '
                f'{self.latch_release:g} rad; without hysteresis noise would switch the law'
            )
        if 0.0 < self.max_excursion < LEAST_EXCURSION:
            raise ValueError(
                f'max_excursion must be at least {LEAST_EXCURSION:g} start distances, or 0 for '
                f'none, got {self.max_excursion:g}; no step would ever be short enough'
            )

    @property
    def remembers(self) -> bool:
        """Whether views are remembered: a lens that is being learnt would move what they hold."""
        return self.options.memory and self.calibrated

    @property
    def mount_is_told(self) -> bool:
        """Whether any setting says how the camera is mounted."""
        return any(getattr(self, name) != getattr(ServoSettings, name) for name in MOUNT)

    def mounted(self, mount: Mount) -> 'ServoSettings':
        """
        Return the settings of a camera mounted as in a description of the robot.

        Who draws one seldom measures: deviations stay what they are.

        Raises ValueError if it is beyond what the settings allow.
        """
        configured = zip(MOUNT, astuple(mount), strict=True)
        return type(self)(**{**self.__getstate__(), **dict(configured)})

    @cached_property
    def carrier(self) -> Rig:
        """The rig that carries the camera."""
        limits = HeadLimits(
            self.pan_min,
            self.pan_max,
            self.pan_speed,
            self.head_latency,
            Joints(self.photograph_pan, self.photograph_tilt),
            self.camera_tilt,
            self.camera_roll,
        )
        return rig_of(self.rig, limits)

    @property
    def mount_yaw(self) -> float:
        """Yaw of the camera on the base, to the left, as configured [rad]."""
        return self.camera_yaw

    @cached_property
    def configured_latency(self) -> float:
        """The latency as it was configured, also where a longer one was identified since [s]."""
        return self.latency

    @cached_property
    def extrinsics(self) -> Extrinsics:
        """What is known of where the camera sits on the base before the robot moves."""
        return configured_extrinsics(
            np.array([self.camera_yaw, self.camera_forward, self.camera_left]),
            np.array(
                [
                    self.camera_yaw_deviation,
                    self.camera_forward_deviation,
                    self.camera_left_deviation,
                ]
            ),
        )

    def __getstate__(self) -> dict[str, Any]:
        # Without the cached options: a law of one's own may hold functions that do not pickle.
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @property
    def compensates(self) -> bool:
        """Whether D is taken from features turned to the desired heading."""
        return self.options.compensate_rotation


@lru_cache(maxsize=64)
def with_identified(settings: ServoSettings, **identified: Any) -> ServoSettings:
    """Return ``settings`` with what was ``identified`` of the base: the same ones at each step."""
    after = replace(settings, **identified)
    vars(after)['configured_latency'] = settings.configured_latency
    return after
