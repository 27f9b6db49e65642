"""State of the servo: the memory of its law, and what estimators carry from image to image."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import ClassVar, NamedTuple

from visual_servo_epipolar.core.estimate.base_model import Curvature, Delay
from visual_servo_epipolar.core.estimate.dead_band import DeadBand
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics
from visual_servo_epipolar.core.estimate.goal_estimate import BaseModel, GoalEstimate, MotionState
from visual_servo_epipolar.core.estimate.map_state import MapState
from visual_servo_epipolar.core.estimate.motion_check import MotionCheck
from visual_servo_epipolar.core.estimate.odometry import Odometry
from visual_servo_epipolar.core.estimate.settings import SettingsT
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.goal import Goal
from visual_servo_epipolar.core.laws.memory import Memory, parts_by_field
from visual_servo_epipolar.core.rigs.rig import Command, Joints
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory

NO_MAP = MapState()


class Known(NamedTuple):
    """What was learnt of the scene, and of base and camera, by a view."""

    map: MapState
    identified: 'Identification'


@dataclass(frozen=True)
class Identification:
    """
    What driving shows of camera and base.

    ``extrinsics`` of the camera on the base, None before the first image; ``curvature`` that the
    base adds to commands; ``dead_band``, what it was seen not to follow; ``delay``, how late it
    obeys; ``odometry``, and whether it tells the truth.
    """

    extrinsics: Extrinsics | None = None
    curvature: Curvature = Curvature()
    dead_band: DeadBand = DeadBand()
    delay: Delay = Delay()
    odometry: Odometry = Odometry()

    @property
    def base(self) -> BaseModel:
        """What driving has shown of the base."""
        dead_band = self.dead_band.linear.value, self.dead_band.angular.value
        return BaseModel(self.delay.value, self.delay.response, dead_band, self.curvature.value)

    def effective(self, settings: SettingsT) -> SettingsT:
        """Return ``settings`` with delay and dead band of the base as they are by now."""
        return self.delay.beside(self.dead_band.beside(settings))


@dataclass(frozen=True)
class ViewState:
    """
    What is seen: ``measurement``, the last estimate of the goal, and perception's ``memory``.

    Both are None before the first. ``period`` is the time between two images [s], smoothed, nan
    before the second; ``rotation_bias``, what the best rotation is off in heading [rad], nan while
    unknown; ``frame``, the number of steps; ``seen_ns``, the stamp of the last image with enough
    features, or of the first one; ``joints``, those of the head at the last image.
    """

    measurement: GoalEstimate | None = None
    memory: PerceptionMemory | None = None
    period: float = math.nan
    rotation_bias: float = math.nan
    frame: int = 0
    seen_ns: int | None = None
    joints: Joints | None = None

    def unseen(self, stamp_ns: int) -> float:
        """Return for how long too few features have been seen, at the time of an image [s]."""
        return 0.0 if self.seen_ns is None else seconds_between(self.seen_ns, stamp_ns)


@dataclass(frozen=True)
class ServoState(Memory):
    """
    State of the servo, in parts; a new run starts from ``ServoState()``.

    ``goal`` is where it drives, with the map of keyframes around it. ``check`` tells whether the
    base moves as it was commanded, ``known`` what was learnt at the reference of that check and at
    the one before, None before the second. ``since_command`` is the time between the last command
    and the one before, by the clock of their sender [s], nan where unknown;
    ``dead_band_residual``, the part of it that the dead band of the base withheld [m/s, rad/s].
    """

    view: ViewState = ViewState()
    motion: MotionState = MotionState()
    goal: Goal[MapState] = Goal()
    identified: Identification = Identification()
    check: MotionCheck = MotionCheck()
    known: tuple[Known, Known] | None = None
    since_command: float = math.nan
    dead_band_residual: Twist = STANDSTILL

    part_of: ClassVar[Mapping[str, str]] = {
        **Memory.part_of,
        **parts_by_field(view=ViewState, motion=MotionState, identified=Identification),
    }

    @property
    def map(self) -> MapState:
        """Map of the goal's surroundings."""
        return self.goal.map or NO_MAP

    @property
    def measurement(self) -> GoalEstimate | None:
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
