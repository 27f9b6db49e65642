"""Record of a run with a fault: ground truth, what the servo saw, commanded and said."""

from dataclasses import dataclass, field
from enum import Enum
import math
from typing import NamedTuple

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose, Twist
from visual_servo_epipolar.core.servo.fusion.map_state import LEAST_CARRIED


class TrueMotion(NamedTuple):
    """Where the robot really is, and how it moves, at ``time_s``."""

    time_s: float
    pose: Pose
    twist: Twist


class Limits(NamedTuple):
    """Limits of speed [m/s, rad/s] and of its ramps [m/s^2, rad/s^2], inf without one."""

    linear: float
    angular: float
    acceleration: float
    angular_acceleration: float


class ServoCommand(NamedTuple):
    """A command of the servo at ``time_s``, and the limits that it was told by then."""

    time_s: float
    twist: Twist
    limits: Limits


class SeenTracks(NamedTuple):
    """What reached the servo at ``time_s``: tracks of the true scene as it was at ``taken_s``."""

    time_s: float
    taken_s: float


@dataclass(slots=True)
class Interventions:
    """
    What somebody did in a run; times are of the steady clock [s].

    ``goals`` are the poses that somebody asked for, ``moved_s`` when the robot was carried,
    ``broken_s`` when its wheels broke, ``woken_s`` when its process went on after it had hung, in
    which time nobody could stop it, ``stopped_s`` when it was told to stand for good.
    """

    goals: list[Pose] = field(default_factory=lambda: [DESIRED_POSE])
    moved_s: list[float] = field(default_factory=list)
    broken_s: list[float] = field(default_factory=list)
    woken_s: float = -math.inf
    stopped_s: float = math.inf


@dataclass(slots=True)
class SightLog:
    """
    What the servo saw of the true scene.

    ``few_s`` is for how long too few features for two views were seen by ``features_s``, less how
    long enough were since [s].
    """

    seen: list[SeenTracks] = field(default_factory=list)
    few_s: float = 0.0
    features_s: float = math.nan

    def note(
        self, features: int, time_s: float, taken_s: float, enough: int, carried_s: float
    ) -> None:
        """
        Note tracks of the true scene if they show the servo where it is.

        They do if there are ``enough``; with a memory of views it goes by fewer, for
        ``carried_s`` in all.
        """
        passed_s = 0.0 if math.isnan(self.features_s) else time_s - self.features_s
        self.features_s = time_s
        if features >= enough:
            self.few_s = max(min(self.few_s, carried_s) - passed_s, 0.0)
        else:
            self.few_s += passed_s
            if features < LEAST_CARRIED or self.few_s > carried_s:
                return
        self.seen.append(SeenTracks(time_s, taken_s))


@dataclass(slots=True)
class Record:
    """
    Record of one run; times are of the steady clock [s].

    ``arrived_s`` is when the robot last said that it had arrived, ``why`` the words of those who
    said why it stands, ``senseless`` what was wrong with a command that is no velocity;
    ``wrong_route`` what was said of a route that must not have been written;
    ``wrong_geometry_s`` is as ``run_monitor.wrong_geometry_s`` [s].
    """

    truths: list[TrueMotion] = field(default_factory=list)
    orders: list[ServoCommand] = field(default_factory=list)
    sight: SightLog = field(default_factory=SightLog)
    interventions: Interventions = field(default_factory=Interventions)
    arrived_s: float = math.inf
    phase: str = 'waiting'
    reason: str = ''
    why: list[str] = field(default_factory=list)
    crashes: list[str] = field(default_factory=list)
    senseless: str = ''
    wrong_route: str = ''
    wrong_geometry_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class SafetyBounds:
    """
    What is right and what is allowed.

    ``sight_s``: how old the newest true sight may be before a moving robot must begin to stand;
    ``delay_s``: from a command to the motors; ``period_s``: between two images. Speeds and
    accelerations are those of the base.
    """

    sight_s: float
    period_s: float
    delay_s: float = 0.0
    base_linear: float = 1.0
    base_angular: float = 1.74
    base_acceleration: float = 0.6
    base_deceleration: float = 0.6
    base_angular_acceleration: float = 1.74
    position_m: float = 0.03
    heading_rad: float = math.radians(1.0)
    excursion_ratio: float = 2.0
    excursion_m: float = 1.0


class RunVerdict(str, Enum):
    """Verdict on a run: two are safe."""

    ARRIVED = 'arrived'
    AT_REST = 'at rest'
    UNJUDGED = 'not judged'  # what failed is the campaign itself
    TRACEBACK = 'traceback'
    BLIND = 'moved without sight'
    DISOBEYED = 'moved after stop'
    LIMITS = 'limits exceeded'
    RAN_AWAY = 'ran away'
    STILL_MOVING = 'still moving at the end'
    WRONG_ARRIVAL = 'wrong arrival'
    WRONG_ROUTE = 'wrong route'
    UNEXPLAINED = 'at rest without a reason'


SAFE = (RunVerdict.ARRIVED, RunVerdict.AT_REST)


MOVING_M_S, MOVING_RAD_S = 1e-3, 1e-3


def moving(twist: Twist) -> bool:
    """Return whether a base of this velocity moves."""
    return abs(twist.linear) > MOVING_M_S or abs(twist.angular) > MOVING_RAD_S


def braking_s(twist: Twist, bounds: SafetyBounds) -> float:
    """Return the time in which the base comes to rest from ``twist`` [s]."""
    return bounds.delay_s + max(
        abs(twist.linear) / bounds.base_deceleration,
        abs(twist.angular) / bounds.base_angular_acceleration,
    )


def speed(twist: Twist) -> str:
    """Return a velocity in words."""
    return f'{twist.linear:.2f} m/s, {twist.angular:.2f} rad/s'
