"""The state of the servo: all that it knows between two images."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.control.command import Command, HALT
from visual_servo_epipolar.core.control.gains import Gains
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import PerceptionMemory
from visual_servo_epipolar.core.servo.identification import Curvature, Slope
from visual_servo_epipolar.core.servo.phases.table import ENDED, Phase
from visual_servo_epipolar.core.servo.ranging import Leg


@dataclass(frozen=True, slots=True)
class ServoState:
    """
    All that the servo knows; a new run starts from ``ServoState()``.

    ``measurement`` is the last one, ``memory`` what perception carries to the next, None before
    the first image; ``distance`` is d_hat [m], nan before the first image; ``target`` the abscissa
    at which e_au is held while e_du is zeroed, ``side`` the sign of e_du when that began,
    ``latched`` whether e_du counts as zero since, ``desired_rate`` how fast its bearing changes
    [rad/s], smoothed;
    ``leg`` is the way since step 1 began, ``range`` the distance that it shows [m]; ``period`` is
    the time between two images [s], smoothed; ``gains`` are those derived when the phase began,
    None where they are given; ``curvature`` and ``slope`` are what driving taught;
    ``dead_band_residual`` is what the dead band of the base kept back; ``settled`` counts frames
    in a row that fulfil the aim of the phase, ``settled_parallax`` is the root mean square of the
    parallax over them.
    """

    phase: Phase = Phase.WAITING
    phase_start_ns: int = 0
    run_start_ns: int = 0
    command: Command = HALT
    measurement: Measurement | None = None
    memory: PerceptionMemory | None = None
    distance: float = math.nan
    target: float = 0.0
    side: float = 1.0
    latched: bool = False
    desired_rate: float = 0.0
    leg: Leg | None = None
    range: float = math.nan
    period: float = math.nan
    gains: Gains | None = None
    curvature: Curvature = Curvature()
    slope: Slope = Slope()
    dead_band_residual: Twist = STANDSTILL
    settled: int = 0
    settled_parallax: float = math.nan
    attempts: int = 1
    frame: int = 0
    reason: str = ''

    @property
    def twist(self) -> Twist:
        """The velocity that was commanded last."""
        return self.command.twist

    @property
    def longitudinal_error(self) -> float:
        """Return y by D [m], negative short of the goal; nan while unknown."""
        return (
            self.measurement.difference / self.slope.value
            if self.measurement is not None
            else math.nan
        )

    @property
    def ended(self) -> bool:
        """Whether the run is over, arrived or failed."""
        return self.phase in ENDED
