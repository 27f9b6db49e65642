"""State by which laws drive: what they carry from one image to the next, in parts."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
import math
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, TypeVar

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.gains import Gains
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.odometry.ranging import Leg, Slope
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.memory import PerceptionMemory
from visual_servo_epipolar.core.rigs.rig import Command, HALT, Joints
from visual_servo_epipolar.core.stamps import seconds_between

StateT = TypeVar('StateT', bound='DriveState')


@dataclass(frozen=True)
class ViewState:
    """
    What is seen: ``measurement``, the last one, and ``memory``, what perception carries on.

    Both are None before the first. ``period`` is the time between two images [s], smoothed, nan
    before the second, and ``jitter``, by how much it varies [s]; ``estimate`` is where the goal is
    by all of that; ``rotation_bias``, what the best rotation is off in heading [rad], nan while
    unknown;
    ``trusted_heading``, the heading error of the last measurement by which it drove [rad], nan
    before; ``frame``, the number of steps; ``seen_ns``, the stamp of the last image with enough
    features, or of the first one; ``joints``, those of the head at the last image.
    """

    measurement: Measurement | None = None
    memory: PerceptionMemory | None = None
    period: float = math.nan
    jitter: float = 0.0
    estimate: GoalEstimate | None = None
    rotation_bias: float = math.nan
    trusted_heading: float = math.nan
    frame: int = 0
    seen_ns: int | None = None
    joints: Joints | None = None

    def unseen(self, stamp_ns: int) -> float:
        """Return for how long too few features have been seen, at the time of an image [s]."""
        return 0.0 if self.seen_ns is None else seconds_between(self.seen_ns, stamp_ns)


@dataclass(frozen=True)
class MotionState:
    """
    What was commanded, and how far that has led.

    ``command``, the last one, of those ``sent``; ``since_command``, the time between the one
    before and it, by the clock of their sender [s], nan where unknown;
    ``dead_band_residual``, the part of it that the dead band of the base withheld [m/s, rad/s];
    ``last_linear``, the speed of the command before the last [m/s].

    ``distance`` to the goal, d_hat of eq. (13) [m], nan before the first image; ``leg``, the path
    since step 1 began; ``range``, the distance measured over it [m], nan while unknown; ``slope``
    of D in step 2; ``travel`` in the phase, backward negative, and ``reversed``, the most that was
    driven backward in the run [m].
    """

    command: Command = HALT
    sent: CommandsSent = CommandsSent()
    since_command: float = math.nan
    dead_band_residual: Twist = STANDSTILL
    last_linear: float = 0.0
    distance: float = math.nan
    leg: Leg | None = None
    range: float = math.nan
    slope: Slope = Slope()
    travel: float = 0.0
    reversed: float = 0.0


@dataclass(frozen=True)
class RunState:
    """
    Where in its run the robot is: the ``phase``, and the ``event`` and ``reason`` of its change.

    ``phase_start_ns`` and ``run_start_ns``, stamps of the images at which phase and run began
    [ns]; ``reason`` also says why it waits, ``warning``, what may make the phase fail;
    ``attempts`` at both steps, from 1, and ``restarts`` of step 1 in this one; ``mount``, shape
    (3,), the mount of the camera by which the phase began.
    """

    phase: Phase = Phase.WAITING
    event: Event = Event.NOTHING
    phase_start_ns: int = 0
    run_start_ns: int = 0
    reason: str = ''
    warning: str = ''
    attempts: int = 1
    restarts: int = 0
    mount: FloatArray | None = None


class Backing(NamedTuple):
    """A way back: its curvature [1/m] and length [m]; inf where none leads to the goal."""

    curvature: float
    way: float


@dataclass(frozen=True)
class LawState:
    """
    What the law of the phase goes by.

    ``target``, the abscissa at unit focal length at which e_au is held while e_du is zeroed;
    ``side``, the sign of e_du when that began; ``latched``, whether e_du counts as zero since;
    ``desired_rate``, the rate of its bearing [rad/s], smoothed; ``gains``, those derived when the
    phase began (that of step 2 as well), None where they are given; ``backing``, the arc on which
    a base that does not turn in place backs off, None without.
    """

    target: float = 0.0
    side: float = 1.0
    latched: bool = False
    desired_rate: float = 0.0
    gains: Gains | None = None
    backing: Backing | None = None


@dataclass(frozen=True)
class Settling:
    """
    How long the aim of the phase has been fulfilled, and where the robot stands.

    ``rest``, the mean of ``rested`` measurements since the last motion was seen, None while it
    moves, and ``rest_square``, the sum of squares by which their D varies; ``settled``, frames in
    a row that fulfil it; ``settled_parallax``, the root mean square of the parallax over them
    [rad]; ``settled_aside``, the mean by which they look aside before a wall, in deviations,
    where there is no map; ``time_in_tolerance``, for how long the phase has been so
    near its aim that a base may be unable to come nearer [s].
    """

    rest: Measurement | None = None
    rested: int = 0
    rest_square: float = 0.0
    settled: int = 0
    settled_parallax: float = math.nan
    settled_aside: float = 0.0
    time_in_tolerance: float = 0.0


def parts_by_field(**parts: type[Any]) -> Mapping[str, str]:
    """Return the name of the part that has a field, by the name of the field."""
    named = {field.name: part for part, kind in parts.items() for field in fields(kind)}
    return MappingProxyType(named)


@dataclass(frozen=True)
class DriveState:
    """State by which laws drive, in parts; ``ServoState`` has what estimators carry as well."""

    view: ViewState = ViewState()
    motion: MotionState = MotionState()
    run: RunState = RunState()
    law: LawState = LawState()
    settling: Settling = Settling()

    # The part that has a field, by the name of it: no two have one of the same name.
    part_of: ClassVar[Mapping[str, str]] = parts_by_field(
        view=ViewState, motion=MotionState, run=RunState, law=LawState, settling=Settling
    )

    def changed(self: StateT, /, **changes: Any) -> StateT:
        """
        Return the state with fields changed, which are those of its parts or its own.

        Raises TypeError if neither the state nor a part has a field of that name.
        """
        parts: dict[str, dict[str, Any]] = {}
        whole = {}
        for name, value in changes.items():
            if name in self.part_of:
                parts.setdefault(self.part_of[name], {})[name] = value
            else:
                whole[name] = value
        for part, fields_of_it in parts.items():
            whole[part] = replace(getattr(self, part), **fields_of_it)
        return replace(self, **whole)

    @property
    def phase(self) -> Phase:
        """Phase of the run."""
        return self.run.phase

    @property
    def reason(self) -> str:
        """Reason of the last change of phase, or why it waits."""
        return self.run.reason

    @property
    def measurement(self) -> Measurement | None:
        """The last measurement; None before the first image."""
        return self.view.measurement

    @property
    def command(self) -> Command:
        """The last command."""
        return self.motion.command

    @property
    def twist(self) -> Twist:
        """Velocity of the last command [m/s, rad/s]."""
        return self.motion.command.twist

    @property
    def yaw_learnt(self) -> float:
        """Change of what the yaw of the camera is taken for, since the phase began [rad]."""
        estimate, mount = self.view.estimate, self.run.mount
        if estimate is None or mount is None:
            return 0.0
        return abs(float(estimate.mount[0] - mount[0]))

    @property
    def longitudinal_error(self) -> float:
        """Longitudinal error y = D / (dD/dy) [m], negative behind the goal; nan while unknown."""
        measurement = self.measurement
        return (
            math.nan if measurement is None else measurement.difference / self.motion.slope.value
        )

    @property
    def ended(self) -> bool:
        """Whether the run is over, arrived or failed."""
        return self.phase.ended
