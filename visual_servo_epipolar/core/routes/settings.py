"""Settings of routes: how key views are chosen, and how the path is followed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from visual_servo_epipolar.core.settings import internal, setting, Settings


@dataclass(frozen=True, kw_only=True)
class TeachSettings(Settings):
    """How a way is taught."""

    GONE: ClassVar[Mapping[str, Any]] = {
        'min_shared': 0.4,
        'max_spacing': 1.5,
        'max_turn': 0.35,
        'overlap': 0.35,
        'features': 250,
    }

    pause: float = setting(
        3.0, 'Standstill that marks a station; 0 = none does [s]', low=0.0, high=60.0
    )


@dataclass(frozen=True, kw_only=True)
class FollowSettings(Settings):
    """How the taught path is followed."""

    GONE: ClassVar[Mapping[str, Any]] = {'steering': 'structure'}

    max_speed: float = setting(
        0.5, 'Largest speed [m/s]; that or max_linear, whichever is lower', low=0.01, high=5.0
    )
    max_turn_rate: float = setting(
        1.0,
        'Largest angular speed [rad/s]; that or max_angular, whichever is lower',
        low=0.01,
        high=10.0,
    )
    steering_length: float = setting(
        0.5, 'Distance over which an offset from the path decays [m]', low=0.05, high=5.0
    )
    reverse: bool = setting(False, 'Drive the route backward, facing as when it was taught')
    station: int = setting(
        -1,
        'Station at which it ends, counted from 0 along the way; -1 = that at its end',
        low=-1,
        high=10000,
    )
    laps: int = setting(
        1,
        'Number of laps; the end must be in sight of the beginning',
        low=1,
        high=1000,
    )
    station_distance: float = internal(
        0.3, 'Way before a station from which the servo drives [m]', low=0.0, high=2.0
    )
    renewals: int = setting(
        0,
        'Further photographs per key view in other light, from successful repetitions; 0 = none',
        low=0,
        high=10,
    )
    lost_timeout: float = setting(
        10.0, 'Longest search for the route when lost [s]', low=0.1, high=600.0
    )
