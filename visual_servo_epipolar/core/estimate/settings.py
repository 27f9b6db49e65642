"""
Settings by which the robot is estimated and driven: the law, its gains, limits, bounds, timeouts.

Laws and estimators are given ``DriveSettings``; what a law is named after is looked up above them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Any, cast, ClassVar, TypeVar

import numpy as np

from visual_servo_epipolar.core.bases.base import Base, BaseLimits, turns_in_place
from visual_servo_epipolar.core.bases.registry import base_of, DEFAULT_BASE
from visual_servo_epipolar.core.estimate.extrinsics import configured_extrinsics, Extrinsics
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.mapping.window import MapSettings
from visual_servo_epipolar.core.rigs.registry import DEFAULT_RIG, rig_of
from visual_servo_epipolar.core.rigs.rig import HeadLimits, Joints, Rig
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

WHEELS_LAG = 0.002  # by which images and odometry may be apart [m]: their stamps are of one clock
LEAST_EXCURSION = 1.05  # start distances: below it noise alone would fail the run
DEFAULT_LAW = 'full'

SettingsT = TypeVar('SettingsT', bound='DriveSettings')


def departure(text: str) -> bool:
    """Declare a departure: a field, False in the paper, that ``text`` describes."""
    value: bool = field(default=False, metadata={'departure': text})
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class Departures:
    """
    Departures from the paper that a law takes, each True or False, and the controls of its steps.

    ``epipole_controls`` takes the place of eq. (12) or (20), with the signature of
    ``equations.auxiliary_controls``; ``matching_control`` that of eqs. (21)-(22), with that of
    ``equations.match_features``. None stands for the paper's own.
    """

    true_sigma: bool = departure(
        'take sigma = sign cos(psi - theta) by cheirality, not as printed'
    )
    discordant_turn: bool = departure(
        'turn e_au to the side where the distance shrinks, and hold it there in step 1'
    )
    retreat: bool = departure("back off at the goal's heading where it lies beside or behind")
    contact_braking: bool = departure('slow down by the time to contact at the end of step 1')
    compensate_rotation: bool = departure('take D from features turned to the desired heading')
    line_following: bool = departure("steer along the goal's axis in step 2, not u_2 = 0")
    slope_gain: bool = departure('scale the gain of step 2 by the measured slope of D')
    speed_ramps: bool = departure('limit accelerations, and brake by them')
    curvature_feedforward: bool = departure('counter the turn that unequal wheels add')
    new_attempts: bool = departure('back off and repeat both steps after a miss (IX-2)')
    final_turn: bool = departure('end with a turn in place to the heading of the goal')
    memory: bool = departure('take bearings, offset and heading from all views of the way')
    learnt_dead_band: bool = departure('learn which commands are too slow for the base to follow')
    anticipation: bool = departure(
        'go by where the robot will be when it obeys, where that is late'
    )
    epipole_controls: Callable[..., tuple[float, float]] | None = None
    matching_control: Callable[..., Twist] | None = None


DEPARTURES: dict[str, str] = {
    item.name: item.metadata['departure']
    for item in fields(Departures)
    if 'departure' in item.metadata
}


def departure_setting(name: str) -> Any:
    """Declare a setting that leaves a departure from the paper out of any law."""
    return internal(True, f'Whether laws may {DEPARTURES[name]}')


@dataclass(frozen=True, kw_only=True)
class ControlSettings(Settings):
    """
    Settings of control: the law, its gains, limits of the base. Units are rad, m and s.

    Epipoles are in units of the focal length, so that gains do not depend on the image size; a
    gain k2 given for pixels is k2 f^(beta/gamma - 1) here, and k_t for px^2 is k_t f^2.
    """

    RENAMED: ClassVar[Mapping[str, str]] = {
        'room': 'spiral_ratio',
        'least_room': 'least_spiral_ratio',
    }
    GONE: ClassVar[Mapping[str, Any]] = {
        'max_jerk': 0.0,
        'max_angular_jerk': 0.0,
        'gain_at_goal': 1.0,
        'gain_slope': 20.0,
    }

    law: str = setting(
        DEFAULT_LAW,
        'Control law: paper (sign as printed), corrected (true sigma), full (all departures), '
        'smooth (one motion), or one of another package',
    )
    true_sigma: bool = departure_setting('true_sigma')
    discordant_turn: bool = departure_setting('discordant_turn')
    retreat: bool = departure_setting('retreat')
    contact_braking: bool = departure_setting('contact_braking')
    line_following: bool = departure_setting('line_following')
    slope_gain: bool = departure_setting('slope_gain')
    speed_ramps: bool = departure_setting('speed_ramps')
    curvature_feedforward: bool = departure_setting('curvature_feedforward')
    new_attempts: bool = departure_setting('new_attempts')
    final_turn: bool = departure_setting('final_turn')
    memory: bool = setting(True, f'Whether laws may {DEPARTURES["memory"]}')
    learnt_dead_band: bool = departure_setting('learnt_dead_band')
    anticipation: bool = departure_setting('anticipation')

    gains: str = setting(
        'given',
        'Gains of both steps: given (as set below), derived (section IV-C, computed when step '
        '1 begins)',
        choices=('given', 'derived'),
    )
    nearest_distance: float = setting(
        1.0, 'Derived gains: lower bound of the distance at the start [m]', low=0.05, high=100.0
    )
    scene_depth: float = internal(
        3.0,
        'Derived gains: depth of the nearest features, used until the slope of D is measured [m]',
        low=0.1,
        high=99,
    )
    latency: float = setting(
        0.1,
        'Time from an image to the motion it causes; above 0.25 full and smooth look ahead [s]',
        low=0.0,
        high=2.0,
    )
    k1: float = internal(
        0.08, 'Step 1: gain k1 of eq. (12) on the current epipole [1/s]', low=0.0, high=5.0
    )
    k2: float = internal(
        0.23, 'Step 1: gain k2 of eq. (12) on the desired epipole', low=0.0, high=5.0
    )
    exponent: float = internal(7.0 / 9.0, 'Step 1: beta/gamma of eq. (12)', low=0.05, high=1.0)
    finite_time: bool = internal(False, 'Step 1: use eq. (20), zero both epipoles in finite time')
    initial_distance: float = setting(
        8.0, 'Upper bound d_hat_0 of the distance to the goal [m]', low=0.1, high=100.0
    )
    min_distance: float = internal(0.3, 'Floor of the estimate d_hat [m]', low=0.01, high=10.0)
    k_t: float = internal(
        16.0, 'Step 2: gain k_t of eq. (21), D at unit focal length [m/s]', low=0, high=200
    )
    approach_rate: float = internal(
        1.0,
        'Step 2: largest closing rate, from the measured slope of D; with speed ramps the end '
        'brakes, up to 4 times as sharply [1/s]',
        low=0.01,
        high=50.0,
    )
    turn_gain: float = internal(
        0.8,
        'Gain of turns in place and of holding e_au; with speed ramps turns end by braking, 4 '
        'times as sharply [1/s]',
        low=0,
        high=5,
    )
    look_ahead: float = internal(
        0.6, 'Step 2: look-ahead of line following [m]', low=0.05, high=10.0
    )
    curvature_drift: float = internal(
        0.01,
        'Curvature feed-forward: how much the curvature from unequal wheels may change per '
        'metre [rad/m]',
        low=0.0,
        high=1.0,
    )
    max_acceleration: float = setting(
        0.25,
        'Speed ramps: linear acceleration; slowing down twice that [m/s^2]',
        low=0.01,
        high=20.0,
    )
    max_angular_acceleration: float = setting(
        1.2,
        'Speed ramps: angular acceleration; slowing down twice that [rad/s^2]',
        low=0.01,
        high=99,
    )
    braking: float = internal(
        0.2, 'Step 1: deceleration to end it with [m/s^2]', low=0.01, high=20.0
    )
    spiral_ratio: float = internal(
        0.4, 'Step 1: fraction of the distance that remains after the spiral', low=0.05, high=0.95
    )
    least_spiral_ratio: float = internal(
        0.15,
        'Step 1: least remaining fraction of the distance after the spiral; below it the '
        'robot backs off',
        low=0.01,
        high=0.95,
    )
    min_displacement: float = internal(
        0.14, 'Step 1: least bearing of the displaced current epipole [rad]', low=0.01, high=0.6
    )
    max_displacement: float = internal(
        0.35, 'Step 1: largest bearing of the displaced current epipole [rad]', low=0.05, high=1.0
    )
    displacement_tolerance: float = internal(
        0.03, 'Step 1: bearing error at which the displacement is done [rad]', low=1e-4, high=0.3
    )
    singular_epipole: float = internal(
        0.02,
        'Step 1: bearing of e_au below which law paper displaces it first [rad]',
        low=0,
        high=0.5,
    )
    base: str = fixed(
        DEFAULT_BASE,
        'Base: differential_drive, car (steers, and never turns in place), or one of another '
        'package',
    )
    max_curvature: float = fixed(
        0.0,
        'Largest curvature of the path of the base; 0 = it turns in place [1/m]',
        low=0.0,
        high=20.0,
    )
    wheelbase: float = fixed(0.33, 'Distance between both axles of a car [m]', low=0.02, high=10.0)
    steering_rate: float = fixed(
        1.0, 'How fast the wheels of a car are steered [rad/s]', low=0.01, high=50.0
    )
    max_linear: float = setting(0.4, 'Largest linear speed [m/s]', low=0.01, high=5.0)
    max_angular: float = setting(0.5, 'Largest angular speed [rad/s]', low=0.01, high=10.0)
    max_speed_ratio: float = setting(
        1.0,
        'Factor on both speed limits; changes follow the ramps',
        low=0.01,
        high=1.0,
    )
    dead_band_linear: float = setting(
        0.0, 'Linear speed that the base cannot follow [m/s]', low=0.0, high=1.0
    )
    dead_band_angular: float = setting(
        0.0, 'Angular speed that the base cannot follow [rad/s]', low=0.0, high=2.0
    )
    dead_band_mode: str = internal(
        'pulse',
        'What becomes of slower commands: raise (the paper), zero, pulse (now and then the '
        'threshold or more, so that the average is right)',
        choices=('raise', 'zero', 'pulse'),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if turns_in_place(self.drive) and self.max_curvature > 0.0:
            raise ValueError(
                f'max_curvature must be 0 for base {self.base}, which turns in place, got '
                f'{self.max_curvature:g} 1/m; set base: car where it does not'
            )
        if self.dead_band_linear > self.max_linear or self.dead_band_angular > self.max_angular:
            raise ValueError(
                'dead bands must not exceed max_linear and max_angular, got '
                f'{self.dead_band_linear:g} m/s and {self.dead_band_angular:g} rad/s; '
                'a command raised to them would break the limits'
            )
        if self.min_displacement > self.max_displacement:
            raise ValueError(
                f'min_displacement must not exceed max_displacement, got '
                f'{self.min_displacement:g} and {self.max_displacement:g} rad'
            )
        if self.derives:
            self._check_derivation()

    @cached_property
    def drive(self) -> Base:
        """The base, within the limits that these settings give it."""
        limits = {item.name: getattr(self, item.name) for item in fields(BaseLimits)}
        return base_of(self.base, BaseLimits(**limits))

    @property
    def derives(self) -> bool:
        """Whether gains are derived where step 1 begins."""
        return self.gains == 'derived'

    def _check_derivation(self) -> None:
        if self.finite_time:
            raise ValueError(
                'gains cannot be derived for finite_time, eq. (20); set gains to given, '
                'or finite_time to false'
            )
        if self.nearest_distance > self.initial_distance:
            raise ValueError(
                f'nearest_distance must not exceed initial_distance, got '
                f'{self.nearest_distance:g} and {self.initial_distance:g} m'
            )


@dataclass(frozen=True, kw_only=True)
class DriveSettings(PerceptionSettings, ControlSettings, ABC):
    """
    Settings of perception and control, of mount, bounds and timeouts, in one flat list.

    Angles in rad, lengths in m, times in s; epipoles in units of the focal length.
    """

    rig: str = fixed(
        DEFAULT_RIG,
        'What carries the camera: fixed (a mount), pan_tilt (a head), or one of another package',
    )
    pan_min: float = fixed(-1.745, 'Head: least pan angle [rad]', low=-6.2, high=0.0)
    pan_max: float = fixed(1.745, 'Head: largest pan angle, to the left [rad]', low=0.0, high=6.2)
    pan_speed: float = fixed(1.5, 'Head: speed of its pan joint [rad/s]', low=0.01, high=20.0)
    head_latency: float = internal(
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
    path_deviation: float = internal(
        0.03, 'Deviation of the scale of the way by odometry: of a metre [m]', low=1e-4, high=1.0
    )
    autostart: bool = fixed(False, 'Start by itself once there are tracks; false: on ~/start')
    latch_engage: float = internal(
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
    retreat_speed: float = internal(0.2, 'Speed of backing off [m/s]', low=0.01, high=2.0)
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
    few_features_timeout: float = internal(
        15.0,
        'Longest drive on the memory of views alone, with fewer than min_features; 0 = none [s]',
        low=0.0,
        high=600.0,
    )
    stale_timeout: float = setting(
        0.5, 'Age of the last tracks at which the robot is stopped [s]', low=0.05, high=60.0
    )
    max_attempts: int = internal(5, 'Attempts before a miss is a failure', low=1, high=20)

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
    @abstractmethod
    def options(self) -> Departures:
        """The law, without the departures that these settings leave out."""

    @property
    def remembers(self) -> bool:
        """Whether views are remembered: a lens that is being learnt would move what they hold."""
        return self.options.memory and self.calibrated

    @cached_property
    def map_by_wheels(self) -> MapSettings:
        """Bounds of a map whose scale is that of the odometry."""
        return MapSettings(scale_deviation=self.path_deviation, lag=WHEELS_LAG)

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
def _identified(settings: DriveSettings, **identified: Any) -> DriveSettings:
    after = replace(settings, **identified)
    vars(after)['configured_latency'] = settings.configured_latency
    return after


def with_identified(settings: SettingsT, **identified: Any) -> SettingsT:
    """Return ``settings`` with what was ``identified`` of the base: the same ones at each step."""
    return cast(SettingsT, _identified(settings, **identified))
