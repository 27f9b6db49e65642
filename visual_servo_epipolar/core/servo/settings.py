"""Settings of the servo: those by which it drives, with the law that they name."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.settings import DEPARTURES, DriveSettings
from visual_servo_epipolar.core.laws.machine import Law, StateMachine
from visual_servo_epipolar.core.laws.registry import law_named, laws_on_arcs, machine_of


@dataclass(frozen=True, kw_only=True)
class ServoSettings(DriveSettings):
    """Settings of the servo: angles in rad, lengths in m, times in s."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.machine  # raises ValueError for an unknown law, and for one that turns in place

    @cached_property
    def _named_law(self) -> Law:
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


@dataclass(frozen=True, kw_only=True)
class StationSettings(ServoSettings):
    """Settings of the servo that ends a route at a station: no head, no start far away."""

    INTERNAL: ClassVar[frozenset[str]] = frozenset(
        'gains nearest_distance initial_distance estimator focal_deviation odometry rig pan_min '
        'pan_max pan_speed photograph_pan photograph_tilt run_timeout'.split()
    )
