"""Settings of control: the law, its gains, and the limits of the base."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar

from visual_servo_epipolar.core.bases.base import Base, BaseLimits, turns_in_place
from visual_servo_epipolar.core.bases.registry import base_of, DEFAULT_BASE
from visual_servo_epipolar.core.laws.law import DEFAULT_LAW, DEPARTURES, Law
from visual_servo_epipolar.core.laws.law import TEXT as LAW_TEXT
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings


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

    law: str = setting(DEFAULT_LAW, LAW_TEXT)
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
    k1: float = setting(
        0.08, 'Step 1: gain k1 of eq. (12) on the current epipole [1/s]', low=0.0, high=5.0
    )
    k2: float = setting(
        0.23, 'Step 1: gain k2 of eq. (12) on the desired epipole', low=0.0, high=5.0
    )
    exponent: float = setting(7.0 / 9.0, 'Step 1: beta/gamma of eq. (12)', low=0.05, high=1.0)
    finite_time: bool = internal(False, 'Step 1: use eq. (20), zero both epipoles in finite time')
    initial_distance: float = setting(
        8.0, 'Upper bound d_hat_0 of the distance to the goal [m]', low=0.1, high=100.0
    )
    min_distance: float = internal(0.3, 'Floor of the estimate d_hat [m]', low=0.01, high=10.0)
    k_t: float = setting(
        16.0, 'Step 2: gain k_t of eq. (21), D at unit focal length [m/s]', low=0, high=200
    )
    approach_rate: float = setting(
        1.0,
        'Step 2: largest closing rate, from the measured slope of D; with speed ramps the end '
        'brakes, up to 4 times as sharply [1/s]',
        low=0.01,
        high=50.0,
    )
    gain_at_goal: float = internal(
        1.0, 'Step 2: factor of its gain at D = 0; 1 is constant', low=0.1, high=10.0
    )
    gain_slope: float = internal(
        20.0, 'Step 2: initial decrease of that factor with |D|', low=0.0, high=1e4
    )
    turn_gain: float = setting(
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
    max_jerk: float = setting(
        0.0, 'Speed ramps: change of the linear acceleration; 0 = off [m/s^3]', low=0.0, high=99.0
    )
    max_angular_jerk: float = setting(
        0.0,
        'Speed ramps: change of the angular acceleration; 0 = off [rad/s^3]',
        low=0.0,
        high=999,
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
        _ = self._named_law  # raises ValueError for an unknown law
        if turns_in_place(self.drive):
            self._refuse_curvature()
        else:
            _ = self.machine  # raises ValueError for a law that turns in place
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

    @cached_property
    def _named_law(self) -> Law:
        # The registry needs the phases, and they need settings.
        from visual_servo_epipolar.core.laws.registry import law_named

        return law_named(self.law)

    @cached_property
    def options(self) -> Law:
        """The law, without the departures that these settings leave out."""
        off = {name: False for name in DEPARTURES if not getattr(self, name)}
        law = self._named_law.changed(off)
        return law if turns_in_place(self.drive) else law.changed({'final_turn': False})

    @cached_property
    def machine(self) -> StateMachine:
        """The state machine of the law, on this base."""
        from visual_servo_epipolar.core.laws.registry import laws_on_arcs, machine_of

        if turns_in_place(self.drive):
            return machine_of(self._named_law)
        machine = machine_of(self._named_law, on_arcs=True)
        turning = [phase.value for phase in machine.rows if phase.turns_in_place]
        if turning:
            raise ValueError(
                f'law {self.law} turns in place when {", ".join(turning)}, base {self.base} '
                f'drives curves of {self.drive.max_curvature:g} 1/m at most; choose a law that '
                f'drives arcs ({", ".join(laws_on_arcs())}), or another base'
            )
        return machine

    @property
    def law_expression(self) -> str:
        """
        Expression of the law that drives: ``law``, less what other settings leave out of it.

        It is ``law`` as written, then ``-departure`` for each departure that ``law`` takes and
        the setting of that name leaves out: ``full-retreat`` for law full and retreat False.
        """
        taken = (name for name in DEPARTURES if getattr(self._named_law, name))
        return self.law + ''.join(f'-{name}' for name in taken if not getattr(self, name))

    def _refuse_curvature(self) -> None:
        if self.max_curvature > 0.0:
            raise ValueError(
                f'max_curvature must be 0 for base {self.base}, which turns in place, got '
                f'{self.max_curvature:g} 1/m; set base: car where it does not'
            )

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
