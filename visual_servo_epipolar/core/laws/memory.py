"""Memory of laws: what they carry from one image to the next, in parts."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
import math
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, TypeVar

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.laws.gains import Gains
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.odometry.legs import Leg

MemoryT = TypeVar('MemoryT', bound='Memory')


@dataclass(frozen=True)
class RunProgress:
    """
    Where in its run the robot is: the ``phase``, and the ``event`` and ``reason`` of its change.

    ``phase_start_ns`` and ``run_start_ns``, stamps of the images at which phase and run began
    [ns]; ``reason`` also says why it waits, ``warning``, what may make the phase fail;
    ``attempts`` at both steps, from 1, and ``restarts`` of step 1 in this one; ``mount``, shape
    (3,), the mount of the camera by which the phase began, and ``travel`` since then, backward
    negative [m].
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
    travel: float = 0.0


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
    a base that does not turn in place backs off, None without; ``leg``, the path since step 1
    began, None without one.
    """

    target: float = 0.0
    side: float = 1.0
    latched: bool = False
    desired_rate: float = 0.0
    gains: Gains | None = None
    backing: Backing | None = None
    leg: Leg | None = None


@dataclass(frozen=True)
class Settling:
    """
    How long the aim of the phase has been fulfilled, and where the robot stands.

    ``rest``, the mean of ``rested`` measurements since the last motion was seen, None while it
    moves, and ``rest_square``, the sum of squares by which their D varies; ``stood``, such a mean
    before the last move, None before the first; ``settled``, frames in a row that fulfil it;
    ``settled_parallax``, the root mean square of the parallax over them [rad]; ``settled_aside``,
    the mean by which they look aside before a wall, in deviations, where there is no map;
    ``time_in_tolerance``, for how long the robot has been so near its aim that its base may be
    unable to come nearer [s]; ``time_at_goal``, for how long it has been within 20 mm of the goal
    by its memory [s]; ``swing_s``, the time between two reversals of a robot that goes back and
    forth near its aim, 0 where it does not [s], and ``scatter``, the deviation of D over the last
    stand of such a one.
    """

    rest: GoalEstimate | None = None
    rested: int = 0
    rest_square: float = 0.0
    stood: GoalEstimate | None = None
    settled: int = 0
    settled_parallax: float = math.nan
    settled_aside: float = 0.0
    time_in_tolerance: float = 0.0
    time_at_goal: float = 0.0
    swing_s: float = 0.0
    scatter: float = 0.0


def parts_by_field(**parts: type[Any]) -> Mapping[str, str]:
    """Return the name of the part that has a field, by the name of the field."""
    named = {field.name: part for part, kind in parts.items() for field in fields(kind)}
    return MappingProxyType(named)


@dataclass(frozen=True)
class Memory:
    """What laws carry from one image to the next, in parts: ``ServoState`` has more of them."""

    run: RunProgress = RunProgress()
    law: LawState = LawState()
    settling: Settling = Settling()

    # The part that has a field, by the name of it: no two have one of the same name.
    part_of: ClassVar[Mapping[str, str]] = parts_by_field(
        run=RunProgress, law=LawState, settling=Settling
    )

    def changed(self: MemoryT, /, **changes: Any) -> MemoryT:
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
    def ended(self) -> bool:
        """Whether the run is over, arrived or failed."""
        return self.phase.ended


def yaw_learnt(goal: GoalEstimate, memory: Memory) -> float:
    """Return how much the yaw of the camera is taken for another since the phase began [rad]."""
    mount = memory.run.mount
    return 0.0 if mount is None else abs(float(goal.mount[0] - mount[0]))
