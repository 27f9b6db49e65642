"""State: all that the servo remembers from one image to the next."""

from dataclasses import dataclass
import math
from typing import NamedTuple

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.command import Command, HALT
from visual_servo_epipolar.core.laws.gains import Gains
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import PerceptionMemory
from visual_servo_epipolar.core.servo.commands_sent import CommandsSent
from visual_servo_epipolar.core.servo.identification.curvature import Curvature
from visual_servo_epipolar.core.servo.identification.dead_band import DeadBand
from visual_servo_epipolar.core.servo.identification.delay import Delay
from visual_servo_epipolar.core.servo.identification.extrinsics import Extrinsics
from visual_servo_epipolar.core.servo.identification.odometry import Odometry
from visual_servo_epipolar.core.servo.identification.ranging import Leg
from visual_servo_epipolar.core.servo.identification.slope import Slope
from visual_servo_epipolar.core.servo.identification.straight_leg import StraightLeg
from visual_servo_epipolar.core.servo.motion.check import MotionCheck
from visual_servo_epipolar.core.servo.remembering import MapState


class Known(NamedTuple):
    """What was learnt of base, camera and way by a view."""

    views: MapState
    extrinsics: Extrinsics | None
    curvature: Curvature
    dead_band: DeadBand
    delay: Delay
    odometry: Odometry


@dataclass(frozen=True)  # without slots: ``values.changed``
class ServoState:
    """
    State of the servo; a new run starts from ``ServoState()``.

    Phase: ``phase``; ``phase_start_ns`` and ``run_start_ns``, stamps of the images at which it and
    the run began [ns]; ``reason`` of the last change of phase, or why it waits; ``warning``, what
    may make the phase fail; ``travel`` in the phase, backward negative, and ``reversed``, the most
    that was driven backward in the run [m]; ``attempts`` at both steps, from 1, and ``restarts``
    of step 1 in this one; ``frame``, the number of steps.

    Measurement and memory: ``measurement``, the last one, and ``memory``, what perception carries
    to the next image, both None before the first; ``trusted_heading``, the heading error of the
    last one by which it drove [rad], nan before; ``views``, the memory of views; ``period``, the
    time between two images [s], smoothed, nan before the second; ``rotation_bias``, what the best
    rotation is off in heading [rad], nan while unknown.

    Command: ``command``, the last one; ``since_command``, the time between the one before and it,
    by the clock of who sends them [s], nan where nobody told; ``dead_band_residual``, the part of
    it that the dead band of the base withheld [m/s, rad/s].

    Distance to the goal: ``distance``, d_hat of eq. (13) [m], nan before the first image; ``leg``,
    the path since step 1 began; ``range``, the distance measured over it [m], nan while unknown.

    Step 1: ``target``, the abscissa at unit focal length at which e_au is held while e_du is
    zeroed; ``side``, the sign of e_du when that began; ``latched``, whether e_du counts as zero
    since; ``desired_rate``, the rate of its bearing [rad/s], smoothed; ``gains``, those derived
    when the phase began (that of step 2 as well), None where they are given.

    Identification: ``extrinsics`` of the camera on the base, and the ``mount``, shape (3,), by
    which the phase began; ``last_linear``, the speed of the command before the last [m/s];
    ``curvature`` that the base adds to commands, ``slope`` of D in step 2; ``dead_band``, what
    the base was seen not to follow; ``delay``, how late it obeys the commands ``sent``;
    ``straight``, the leg of step 2 by the memory of views, None without; ``odometry``, and whether
    it tells the truth; ``motion``, whether the base moves as it was told, and what was ``known``
    at the reference of that check and at the one before, None before the second.

    Settling: ``settled``, frames in a row that fulfil the aim of the phase; ``settled_parallax``,
    the root mean square of the parallax over them [rad]; ``settled_aside``, the mean by which
    they look aside before a wall, in deviations, of who has no memory; ``lingered``, for how long
    the phase has been so near its aim that a base may be unable to come nearer [s].
    """

    phase: Phase = Phase.WAITING
    phase_start_ns: int = 0
    run_start_ns: int = 0
    command: Command = HALT
    measurement: Measurement | None = None
    memory: PerceptionMemory | None = None
    views: MapState = MapState()
    distance: float = math.nan
    target: float = 0.0
    side: float = 1.0
    latched: bool = False
    desired_rate: float = 0.0
    leg: Leg | None = None
    range: float = math.nan
    rotation_bias: float = math.nan
    period: float = math.nan
    gains: Gains | None = None
    curvature: Curvature = Curvature()
    extrinsics: Extrinsics | None = None
    mount: FloatArray | None = None
    last_linear: float = 0.0
    slope: Slope = Slope()
    dead_band: DeadBand = DeadBand()
    delay: Delay = Delay()
    sent: CommandsSent = CommandsSent()
    straight: StraightLeg | None = None
    odometry: Odometry = Odometry()
    motion: MotionCheck = MotionCheck()
    known: tuple[Known, Known] | None = None
    since_command: float = math.nan
    dead_band_residual: Twist = STANDSTILL
    trusted_heading: float = math.nan
    settled: int = 0
    settled_parallax: float = math.nan
    settled_aside: float = 0.0
    lingered: float = 0.0
    attempts: int = 1
    restarts: int = 0
    frame: int = 0
    travel: float = 0.0
    reversed: float = 0.0
    reason: str = ''
    warning: str = ''

    @property
    def twist(self) -> Twist:
        """Velocity of the last command [m/s, rad/s]."""
        return self.command.twist

    @property
    def yaw_learnt(self) -> float:
        """Change of what the yaw of the camera is taken for, since the phase began [rad]."""
        if self.extrinsics is None or self.mount is None:
            return 0.0
        return abs(float(self.extrinsics.mount[0] - self.mount[0]))

    @property
    def longitudinal_error(self) -> float:
        """Longitudinal error y = D / (dD/dy) [m], negative behind the goal; nan while unknown."""
        return (
            self.measurement.difference / self.slope.value
            if self.measurement is not None
            else math.nan
        )

    @property
    def ended(self) -> bool:
        """Whether the run is over, arrived or failed."""
        return self.phase.ended
