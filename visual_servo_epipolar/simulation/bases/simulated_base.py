"""Base: what every simulated robot base takes and gives."""

from typing import Any, Protocol

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.command import Command


class SimulatedBase(Protocol):
    """
    A robot on the floor: commands in, ground truth and odometry out.

    It lives in simulated time and moves in ``advance`` alone.
    """

    settings: Any
    """What it is like; a host may put other values of one class in place while it drives."""

    @property
    def now_ns(self) -> int:
        """Simulated time [ns]."""
        ...

    @property
    def pose(self) -> Pose:
        """Ground truth in the world."""
        ...

    @property
    def twist(self) -> Twist:
        """True velocity."""
        ...

    @property
    def odometry(self) -> Pose:
        """Pose by the wheels, from (0, 0, 0) at the start; it drifts."""
        ...

    @property
    def moving(self) -> bool:
        """Whether the true velocity differs from zero."""
        ...

    @property
    def timed_out(self) -> bool:
        """Whether the last command is older than the base accepts."""
        ...

    def command(self, command: Command) -> None:
        """Take ``command`` now."""
        ...

    def halt(self) -> None:
        """Drop every command and brake."""
        ...

    def advance(self, now_ns: int) -> None:
        """Move until ``now_ns`` [ns]; a time that is not later moves nothing."""
        ...


class SimulatedBaseFactory(Protocol):
    """Makes a base from settings of its own class, at ``pose`` and time ``now_ns`` [ns]."""

    def __call__(self, settings: Any, pose: Pose, *, seed: int, now_ns: int = 0) -> SimulatedBase:
        """Return the base at a standstill; ``seed`` fixes the noise of its odometry."""
        ...
