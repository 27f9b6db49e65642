"""State of the servo: what laws go by, and what estimators carry from one image to the next."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from visual_servo_epipolar.core.estimate.base_model import Curvature, Delay
from visual_servo_epipolar.core.estimate.dead_band import DeadBand
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics, StraightLeg
from visual_servo_epipolar.core.estimate.goal_estimate import BaseModel
from visual_servo_epipolar.core.estimate.map_state import MapState
from visual_servo_epipolar.core.estimate.motion_check import MotionCheck
from visual_servo_epipolar.core.estimate.odometry import Odometry
from visual_servo_epipolar.core.estimate.settings import SettingsT
from visual_servo_epipolar.core.goal import Goal
from visual_servo_epipolar.core.laws.state import DriveState, parts_by_field

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
    obeys; ``odometry``, and whether it tells the truth; ``straight``, the leg of step 2 by the
    map, None without.
    """

    extrinsics: Extrinsics | None = None
    curvature: Curvature = Curvature()
    dead_band: DeadBand = DeadBand()
    delay: Delay = Delay()
    odometry: Odometry = Odometry()
    straight: StraightLeg | None = None

    @property
    def base(self) -> BaseModel:
        """What driving has shown of the base."""
        dead_band = self.dead_band.linear.value, self.dead_band.angular.value
        return BaseModel(self.delay.value, self.delay.response, dead_band, self.curvature.value)

    def effective(self, settings: SettingsT) -> SettingsT:
        """Return ``settings`` with delay and dead band of the base as they are by now."""
        return self.delay.beside(self.dead_band.beside(settings))


@dataclass(frozen=True)
class ServoState(DriveState):
    """
    State of the servo, in parts; a new run starts from ``ServoState()``.

    ``goal`` is where it drives, with the map of keyframes around it. ``check`` tells whether the
    base moves as it was commanded, ``known`` what was learnt at the reference of that check and at
    the one before, None before the second.
    """

    goal: Goal[MapState] = Goal()
    identified: Identification = Identification()
    check: MotionCheck = MotionCheck()
    known: tuple[Known, Known] | None = None

    part_of: ClassVar[Mapping[str, str]] = {
        **DriveState.part_of,
        **parts_by_field(identified=Identification),
    }

    @property
    def map(self) -> MapState:
        """Map of the goal's surroundings."""
        return self.goal.map or NO_MAP
