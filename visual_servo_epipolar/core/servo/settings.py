"""Settings of the servo: gains, limits and thresholds, each with unit and range."""

from dataclasses import dataclass

from visual_servo_epipolar.core.settings import setting, Settings


@dataclass(frozen=True, kw_only=True)
class ServoSettings(Settings):
    """
    What the servo may be told. Angles in rad, lengths in m, times in s.

    Epipoles are in units of the focal length, so that gains do not depend on the image size; a
    gain k2 given for pixels is k2 f^(beta/gamma - 1) here, and k_t for px^2 is k_t f^2.
    """

    law: str = setting(
        'full',
        'Control law: paper (sign as printed), corrected (true sigma), full (discordant turn too)',
        choices=('paper', 'corrected', 'full'),
    )
    estimator: str = setting(
        'soft_planar',
        'Estimator: lmeds_8pt (the paper), planar_3dof (focal length unknown), planar_2dof '
        '(upright camera), soft_planar (tilt, roll and floor jitter found out)',
        choices=('lmeds_8pt', 'planar_3dof', 'planar_2dof', 'soft_planar'),
        read_only=True,
    )
    seed: int = setting(0, 'Seed of the random subsets', low=0, high=2**31 - 1, read_only=True)
    autostart: bool = setting(True, 'Start by itself once there are tracks', read_only=True)

    gains: str = setting(
        'given',
        'Where gains come from: given (as set below), derived (section IV-C, where step 1 begins)',
        choices=('given', 'derived'),
    )
    nearest_distance: float = setting(
        1.0, 'Derived gains: lower bound of the distance at the start [m]', low=0.05, high=100.0
    )
    scene_depth: float = setting(
        3.0,
        'Derived gains: depth of the nearest features, until D shows its slope [m]',
        low=0.1,
        high=99,
    )
    latency: float = setting(
        0.1, 'Time from an image to the motion it causes, for gains [s]', low=0.0, high=2.0
    )
    k1: float = setting(
        0.08, 'Gain k1 of eq. (12) on the current epipole [1/s]', low=0.0, high=5.0
    )
    k2: float = setting(0.23, 'Gain k2 of eq. (12) on the desired epipole', low=0.0, high=5.0)
    exponent: float = setting(7.0 / 9.0, 'beta/gamma of eq. (12)', low=0.05, high=1.0)
    finite_time: bool = setting(False, 'Use eq. (20): zero both epipoles in finite time')
    initial_distance: float = setting(
        8.0, 'Upper bound d_hat_0 of the distance to the goal [m]', low=0.1, high=100.0
    )
    min_distance: float = setting(0.3, 'Floor of the estimate d_hat [m]', low=0.01, high=10.0)
    k_t: float = setting(
        16.0, 'Gain k_t of eq. (21), D at unit focal length [m/s]', low=0, high=200
    )
    approach_rate: float = setting(
        1.0,
        'Law full: rate at which step 2 closes in at most, as the slope of D has it [1/s]',
        low=0.01,
        high=50.0,
    )
    gain_at_goal: float = setting(
        1.0, 'Law full: factor of the gain of step 2 at D = 0; 1 is constant', low=0.1, high=10.0
    )
    gain_slope: float = setting(
        20.0, 'Law full: how fast that factor falls with |D| at first', low=0.0, high=1e4
    )
    turn_gain: float = setting(
        0.8, 'Gain of turns in place and of holding e_au [1/s]', low=0, high=5
    )

    compensate_rotation: bool = setting(
        True, 'Law full: turn features to the desired heading before taking D'
    )

    line_following: bool = setting(
        True, "Law full: steer along the goal's axis in step 2 instead of u_2 = 0"
    )
    look_ahead: float = setting(0.6, 'Look-ahead of line following [m]', low=0.05, high=10.0)
    curvature_drift: float = setting(
        0.01,
        'Law full: change in a metre of the turn that was not commanded [rad/m]',
        low=0.0,
        high=1.0,
    )
    max_acceleration: float = setting(
        0.25, 'Law full: linear acceleration; slowing down twice that [m/s^2]', low=0.01, high=20.0
    )
    max_angular_acceleration: float = setting(
        1.2, 'Law full: angular acceleration; slowing down twice that [rad/s^2]', low=0.01, high=99
    )
    braking: float = setting(
        0.2, 'Law full: deceleration to end step 1 with [m/s^2]', low=0.01, high=20.0
    )
    room: float = setting(
        0.4,
        'Part of the distance that the spiral of step 1 leaves for step 2',
        low=0.05,
        high=0.95,
    )
    least_room: float = setting(
        0.15,
        'Law full: part of the distance below which the spiral ends too near the goal',
        low=0.01,
        high=0.95,
    )
    min_displacement: float = setting(
        0.14, 'Least bearing of the displaced current epipole [rad]', low=0.01, high=0.6
    )
    max_displacement: float = setting(
        0.35, 'Largest bearing of the displaced current epipole [rad]', low=0.05, high=1.0
    )
    displacement_tolerance: float = setting(
        0.03, 'Bearing error at which the displacement is done [rad]', low=1e-4, high=0.3
    )
    singular_epipole: float = setting(
        0.02, 'Bearing of e_au below which the paper displaces it first [rad]', low=0, high=0.5
    )

    latch_engage: float = setting(
        0.002, 'Bearing of e_du at which step 1 calls it zero [rad]', low=0.0, high=0.2
    )
    latch_release: float = setting(
        0.007, 'Bearing of e_du at which it has escaped again [rad]', low=0.0, high=0.5
    )
    align_tolerance: float = setting(
        0.0015, 'Bearing of e_au at which step 1 ends [rad]', low=1e-5, high=0.1
    )
    align_frames: int = setting(3, 'Frames in a row that must be aligned', low=1, high=100)
    arrival_difference: float = setting(
        1e-4, '|D| at unit focal length below which the features match', low=1e-8, high=0.1
    )
    arrival_heading: float = setting(
        6e-4, 'Heading error at which the robot faces as the goal does [rad]', low=1e-5, high=0.1
    )
    arrival_parallax: float = setting(
        1.5e-4,
        'Parallax beyond noise above which the robot is not at the goal [rad]',
        low=0,
        high=1,
    )
    arrival_frames: int = setting(5, 'Frames in a row that must match', low=1, high=100)

    near_parallax: float = setting(
        0.02, 'Parallax below which a goal without trusted bearings is near [rad]', low=0, high=1
    )
    sideways_bearing: float = setting(
        0.6,
        'Law full: bearing of e_du above which the robot backs off first [rad]',
        low=0,
        high=1.6,
    )
    retreat_bearing: float = setting(
        0.5, 'Bearing of e_du at which backing off ends [rad]', low=0.01, high=1.5
    )
    retreat_heading: float = setting(
        0.1, 'Heading error above which the robot turns before it backs off [rad]', low=0, high=1
    )
    retreat_difference: float = setting(
        0.06, '|D| at unit focal length to back off to at least', low=0.001, high=1.0
    )
    retreat_speed: float = setting(0.2, 'Speed of backing off [m/s]', low=0.01, high=2.0)
    divergence: float = setting(
        1.5, 'Bearing of e_du at which step 1 has failed [rad]', low=0.5, high=1.57
    )

    min_parallax: float = setting(
        2.5, 'Parallax below which there is no baseline [px]', low=0.0, high=100.0
    )
    min_features: int = setting(12, 'Features below which the servo holds', low=8, high=1000)
    min_confidence: float = setting(
        0.02, 'Confidence of the cheirality vote to be trusted, 0 to 1', low=0.0, high=1.0
    )
    keep_features: int = setting(
        30, 'Law full: features that no turn may take out of view', low=8, high=1000
    )
    max_deviation: float = setting(
        0.1, 'Standard deviation of a bearing above which it is not trusted [rad]', low=0, high=3
    )
    max_leap: float = setting(
        0.15, 'Change of a bearing in one frame that is doubted at first [rad]', low=0.0, high=4.0
    )
    min_spread: float = setting(
        0.03, 'Least spread of the features that agree [rad]', low=0.0, high=1.0
    )
    pixel_noise: float = setting(
        0.3, 'Deviation of a tracked coordinate before residuals show it [px]', low=0.01, high=10
    )
    floor_jitter: float = setting(
        0.0017, 'Deviation of tilt and of roll by the floor, view by view [rad]', low=0, high=0.1
    )

    focal_deviation: float = setting(
        0.0,
        'Estimator soft_planar: deviation of the logarithm of the focal length in camera_info; 0 '
        'for a calibrated camera, 1 where it may be anything',
        low=0.0,
        high=3.0,
        read_only=True,
    )

    max_linear: float = setting(0.4, 'Largest linear speed [m/s]', low=0.01, high=5.0)
    max_angular: float = setting(0.5, 'Largest angular speed [rad/s]', low=0.01, high=10.0)
    dead_band_linear: float = setting(
        0.0, 'Linear speed that the base cannot follow [m/s]', low=0.0, high=1.0
    )
    dead_band_angular: float = setting(
        0.0, 'Angular speed that the base cannot follow [rad/s]', low=0.0, high=2.0
    )
    dead_band_mode: str = setting(
        'pulse',
        'What becomes of slower commands: raise (the paper), zero, pulse (now and then the '
        'threshold, so that the average is right)',
        choices=('raise', 'zero', 'pulse'),
    )
    phase_timeout: float = setting(120.0, 'Longest stay in one phase [s]', low=1.0, high=3600.0)
    run_timeout: float = setting(600.0, 'Longest run [s]', low=1.0, high=86400.0)
    holding_timeout: float = setting(5.0, 'Longest wait for lost tracks [s]', low=0.1, high=600.0)
    stale_timeout: float = setting(
        0.5, 'Age of the last tracks at which the robot is stopped [s]', low=0.05, high=60.0
    )
    max_attempts: int = setting(5, 'Attempts before a miss is a failure', low=1, high=20)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.latch_engage > self.latch_release:
            raise ValueError(
                f'latch_engage must not exceed latch_release, got {self.latch_engage:g} and '
                f'{self.latch_release:g} rad; without hysteresis noise would switch the law'
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

    @property
    def derives(self) -> bool:
        """Whether gains are derived where step 1 begins."""
        return self.gains == 'derived'

    @property
    def compensates(self) -> bool:
        """Whether D is taken from features turned to the desired heading."""
        return self.law == 'full' and self.compensate_rotation

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
