"""The estimate of the goal: where it is, how sure, by which motion; one value an image."""

from dataclasses import dataclass, field, fields
from enum import Enum
import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics, YAW
from visual_servo_epipolar.core.estimate.map_state import FilteredPose, PLACE
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.odometry.legs import Slope
from visual_servo_epipolar.core.reasons import Reason, reason_of
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.rivals import Rivals

UNKNOWN: FloatArray = np.full((3, 3), np.nan)
USUAL_STEP_S = 0.1  # between two images, where no others came before


class Source(Enum):
    """What an estimate is by; CARRIED: by the memory of views, too few features for two views."""

    NOTHING = ''
    TWO_VIEWS = 'two views'
    MEMORY = 'memory of views'
    CARRIED = 'memory of views alone'


class BaseModel(NamedTuple):
    """
    Base as driving shows it.

    ``delay`` [s], 0 until it is known, and ``response``, how late it obeys at all [s], nan until
    then; ``dead_band`` [m/s, rad/s]; ``curvature`` [rad/m].
    """

    delay: float = 0.0
    response: float = math.nan
    dead_band: tuple[float, float] = (0.0, 0.0)
    curvature: float = 0.0


@dataclass(frozen=True)
class MotionState:
    """
    What was commanded, and how far that has led.

    ``command``, the last one, of those ``sent``, and ``last_linear``, the speed of the one before
    it [m/s].

    ``distance`` to the goal, d_hat of eq. (13) [m], nan before the first image; ``slope`` of D in
    step 2; ``reversed``, the most that was driven backward in the run [m].
    """

    command: Command = HALT
    sent: CommandsSent = CommandsSent()
    last_linear: float = 0.0
    distance: float = math.nan
    slope: Slope = Slope()
    reversed: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class GoalEstimate(Measurement):
    """
    Where the goal is, by all images up to that of ``stamp_ns``: all that a law goes by.

    It is the measurement of the axle; ``offset`` and ``heading_error`` have the
    ``pose_covariance`` of right, ahead and heading, (3, 3), nan without a scale. ``mount`` is yaw
    [rad], forward and left [m] of the camera, (3,), and ``base`` the model of the base by which it
    was made. ``range`` is the distance that bearings and commands show [m], nan while they hardly
    do, and ``place`` the average of what the map has, None without. ``motion`` is what was
    commanded until then; ``period`` the time between two images [s], smoothed, nan before the
    second, and ``jitter``, by how much it varies [s]; ``trusted_heading``, the heading error of
    the last measurement by which it drove [rad], nan before; ``followed``, two geometries that
    fit, until the way shows which is false, None where one is left.
    """

    pose_covariance: FloatArray = field(default_factory=lambda: UNKNOWN)
    mount: FloatArray = field(default_factory=lambda: np.zeros(3))
    base: BaseModel = BaseModel()
    range: float = math.nan
    place: FilteredPose | None = None
    motion: MotionState = MotionState()
    period: float = math.nan
    jitter: float = 0.0
    trusted_heading: float = math.nan
    followed: Rivals | None = None
    source: Source = Source.NOTHING

    @property
    def cause(self) -> Reason:
        """Why no bearings are trusted, or what else is wrong."""
        return reason_of(self.reason)

    @property
    def twist(self) -> Twist:
        """Velocity of the last command [m/s, rad/s]."""
        return self.motion.command.twist

    def distance(self, most: float = math.inf) -> float:
        """Return the distance from the goal [m]; ``most`` of d_hat where none was measured."""
        if self.offset is not None:
            return math.hypot(*self.offset)
        return self.range if self.range > 0.0 else min(self.motion.distance, most)

    def in_base(self) -> tuple[FloatArray, FloatArray] | None:
        """
        Return the goal in axes of the base, (3,): x ahead, y left [m], yaw [rad]; None unscaled.

        Its covariance is (3, 3).
        """
        if self.offset is None:
            return None
        (right, ahead), heading = self.offset, self.heading_error
        sine, cosine = math.sin(heading), math.cos(heading)
        x, y = right * sine - ahead * cosine, right * cosine + ahead * sine
        slope = np.array([[sine, -cosine, y], [cosine, sine, -x], [0.0, 0.0, -1.0]])
        return np.array([x, y, -heading]), slope @ self.pose_covariance @ slope.T


def usual_step(period: float) -> float:
    """Return the time that usually passes between two images [s], by their smoothed ``period``."""
    return period if period > 0.0 else USUAL_STEP_S


def goal_estimate(
    measurement: Measurement,
    reading: MapLocalization | None,
    mounted: Extrinsics,
    base: BaseModel,
    **known: Any,
) -> GoalEstimate:
    """Return the estimate by a ``measurement`` of the axle, a ``reading`` of the map, and more."""
    covariance, source = UNKNOWN, Source.NOTHING
    if measurement.offset is not None and reading is not None:
        covariance = at_axle(reading.covariance[:PLACE, :PLACE], measurement, mounted)
        source = Source.CARRIED if measurement.carried else Source.MEMORY
    elif measurement.bearings is not None:
        source = Source.TWO_VIEWS
    return GoalEstimate(
        **{item.name: getattr(measurement, item.name) for item in fields(Measurement)},
        pose_covariance=covariance,
        mount=mounted.mount,
        base=base,
        range=mounted.distance if mounted.is_ranged else math.nan,
        source=source,
        **known,
    )


def at_axle(camera: FloatArray, measurement: Measurement, mounted: Extrinsics) -> FloatArray:
    """
    Return the covariance of the axle's pose, (3, 3), from that of the camera's.

    The mount is uncertain as well: its yaw turns the offset about the goal, and the lever arm
    swings as far as the robot has turned since the photograph.
    """
    (x, y), heading = measurement.offset or (0.0, 0.0), measurement.heading_error
    yaw, forward, left = mounted.mount.tolist()
    sine, cosine = math.sin(yaw), math.cos(yaw)
    level = np.array([[cosine, -sine], [sine, cosine]])  # from axes of the camera to the base's
    turned = np.array(
        [
            forward * math.cos(heading) - left * math.sin(heading),
            forward * math.sin(heading) + left * math.cos(heading),
        ]
    )
    slope = np.eye(3)
    slope[:2, :2], slope[:2, 2] = level, level @ turned
    by_mount = np.zeros((3, 3))
    by_mount[:2, 0] = -y, x
    by_mount[:2, 1:] = -level @ camera_swing(0.0, heading)
    off = mounted.likely - mounted.mount  # until the likely one is believed
    known = mounted.covariance[YAW:, YAW:] + np.outer(off, off)
    return np.asarray(slope @ camera @ slope.T + by_mount @ known @ by_mount.T)
