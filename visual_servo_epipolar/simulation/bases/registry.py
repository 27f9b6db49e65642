"""
Simulated bases: their protocol, and a registry by the names of scenarios.

A new one is a file of its own and a row here.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple, Protocol

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.simulation.bases.ackermann import Ackermann, AckermannSettings
from visual_servo_epipolar.simulation.bases.pioneer import Pioneer, PioneerSettings
from visual_servo_epipolar.simulation.view import LEVEL, Nod


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

    @property
    def pose(self) -> Pose:
        """Ground truth in the world."""

    @property
    def twist(self) -> Twist:
        """True velocity."""

    @property
    def odometry(self) -> Pose:
        """Pose by the wheels, from (0, 0, 0) at the start; it drifts."""

    @property
    def timed_out(self) -> bool:
        """Whether the last command is older than the base accepts."""

    def command(self, command: Command) -> None:
        """Take ``command`` now."""

    def halt(self) -> None:
        """Drop every command and brake."""

    def advance(self, now_ns: int) -> None:
        """Move until ``now_ns`` [ns]; a time that is not later moves nothing."""


class SimulatedBaseModel(NamedTuple):
    """
    One row: the class of settings, which no other row has, and the class of the base.

    ``factory`` is called as ``new_base``; ``seed`` fixes the noise of the odometry.
    """

    settings: type[Settings]
    factory: Callable[..., SimulatedBase]


SIMULATED_BASES: dict[str, SimulatedBaseModel] = {
    'pioneer': SimulatedBaseModel(PioneerSettings, Pioneer),
    'ackermann': SimulatedBaseModel(AckermannSettings, Ackermann),
}


def nod_of(base: SimulatedBase) -> Nod:
    """Return the pitch of the body of a base that has one, as its ``nodding``."""
    return getattr(base, 'nodding', LEVEL)


def base_name(settings: Settings) -> str:
    """Return the name of the base that ``settings`` belong to; KeyError if there is none."""
    return {model.settings: name for name, model in SIMULATED_BASES.items()}[type(settings)]


def model_settings(name: str, values: Settings) -> Settings:
    """Return the settings of the base called ``name``, of those ``values`` which it has."""
    kind = SIMULATED_BASES[name].settings
    return kind(**{item.name: getattr(values, item.name) for item in fields(kind)})


def new_base(settings: Settings, pose: Pose, *, seed: int, now_ns: int = 0) -> SimulatedBase:
    """Return the base that ``settings`` describe, at ``pose`` and time ``now_ns`` [ns]."""
    return SIMULATED_BASES[base_name(settings)].factory(settings, pose, seed=seed, now_ns=now_ns)
