"""Circumstances of a start of step 1, for gains; no library is loaded, which help needs."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.settings import setting, Settings


@dataclass(frozen=True, kw_only=True)
class Circumstances(Settings):
    """Circumstances of a start of step 1; bearings are |atan e|, e at unit focal length."""

    concordant: bool = setting(False, 'Whether the epipoles have the same sign')
    current: float = setting(0.35, 'Bearing |atan e_au| at least [rad]', low=0.001, high=1.57)
    desired: float = setting(0.6, 'Bearing |atan e_du| at most [rad]', low=0.001, high=1.56)
    farthest: float = setting(8.0, 'Upper bound d_hat_0 of the distance [m]', low=0.1, high=100.0)
    nearest: float = setting(1.0, 'Lower bound of the distance d_0 [m]', low=0.05, high=100.0)
    max_linear: float = setting(0.4, 'Largest linear speed [m/s]', low=0.01, high=5.0)
    max_angular: float = setting(0.5, 'Largest angular speed [rad/s]', low=0.01, high=10.0)
    deceleration: float = setting(0.5, 'Deceleration of the base [m/s^2]', low=0.01, high=20.0)
    rate: float = setting(11.0, 'Images a second [Hz]', low=0.5, high=1000.0)
    latency: float = setting(0.0, 'From image to motion [s]', low=0.0, high=2.0)
    landing: float = setting(0.002, 'Bearing of e_du that is zero [rad]', low=1e-6, high=0.2)
    depth: float = setting(3.0, 'Depth of the nearest features [m]', low=0.1, high=99)
    spread: float = setting(0.38, 'Mean of |p_d|^2 at unit focal length', low=1e-3, high=10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.nearest > self.farthest:
            raise ValueError(
                f'nearest must not exceed farthest, got {self.nearest:g} and {self.farthest:g} m'
            )
        if self.landing >= self.desired:
            raise ValueError(
                f'landing must be below desired, got {self.landing:g} and {self.desired:g} rad; '
                'e_du counts as zero already'
            )
        if not self.concordant and self.current + self.desired > 0.5 * math.pi:
            raise ValueError(
                f'discordant bearings must not add up to more than {0.5 * math.pi:.4g} rad, got '
                f'{self.current:g} and {self.desired:g}: e_au may pass through infinity; '
                'turn towards the heading of the goal first'
            )

    @property
    def period(self) -> float:
        """Time from an image to the end of the command that it causes [s]."""
        return 1.0 / self.rate + self.latency

    @property
    def ratio(self) -> float:
        """Largest ratio d_hat_0 / d_0 of the first estimate to the distance."""
        return self.farthest / self.nearest
