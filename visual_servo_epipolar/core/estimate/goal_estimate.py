"""The estimate of the goal: its pose and covariance, mount and base; one value an image."""

from dataclasses import dataclass
from enum import Enum
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics, YAW
from visual_servo_epipolar.core.estimate.map_state import FilteredPose
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.localization import MapMeasurement
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.reasons import Reason, reason_of
from visual_servo_epipolar.core.rigs.fixed_mount import camera_swing

UNKNOWN: FloatArray = np.full((3, 3), np.nan)


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


@dataclass(frozen=True, slots=True, eq=False)
class GoalEstimate:
    """
    Where the goal is, by all images up to that of ``stamp_ns``.

    ``bearings`` are those of the axle, None where none are trusted: the ``reason`` says why not;
    ``bearings_covariance`` is that of psi and phi, (2, 2) [rad^2]. ``offset`` is the axle's, right
    and ahead of the goal's [m], None without a scale, and ``heading`` its heading error, left
    positive [rad], with the ``covariance`` of right, ahead and heading, (3, 3), nan without a
    scale. ``difference`` is D at unit focal length with its ``difference_slope`` along the goal's
    axis [1/m], and ``difference_deviation``; ``margins``, how far the robot may turn to the left
    and to the right before features leave the view [rad]. ``mount`` is yaw [rad], forward and
    left [m] of the camera, (3,), and ``base`` the model of the base by which it was made.
    ``range`` is the distance that bearings and commands show [m], nan while they hardly do, and
    ``place`` the average of what the map has, None without.
    """

    stamp_ns: int
    bearings: Bearings | None
    bearings_covariance: FloatArray
    offset: tuple[float, float] | None
    heading: float
    covariance: FloatArray
    difference: tuple[float, float, float]
    margins: tuple[float, float]
    mount: FloatArray
    base: BaseModel
    range: float
    place: FilteredPose | None
    source: Source
    reason: Reason

    def in_base(self) -> tuple[FloatArray, FloatArray] | None:
        """
        Return the goal in axes of the base, (3,): x ahead, y left [m], yaw [rad]; None unscaled.

        Its covariance is (3, 3).
        """
        if self.offset is None:
            return None
        return in_base(np.array([*self.offset, self.heading]), self.covariance)


def in_base(place: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return the goal in axes of the base, (3,), and its covariance, (3, 3).

    ``place``, (3,), is right and ahead of the goal's axes [m] and the heading error [rad].
    """
    right, ahead, heading = place.tolist()
    sine, cosine = math.sin(heading), math.cos(heading)
    x, y = right * sine - ahead * cosine, right * cosine + ahead * sine
    slope = np.array([[sine, -cosine, y], [cosine, sine, -x], [0.0, 0.0, -1.0]])
    return np.array([x, y, -heading]), slope @ covariance @ slope.T


def goal_estimate(
    measurement: Measurement,
    reading: MapMeasurement | None,
    mounted: Extrinsics,
    base: BaseModel,
    place: FilteredPose | None = None,
) -> GoalEstimate:
    """Return the estimate by a ``measurement`` of the axle, and what the map has ``reading``."""
    covariance, source = UNKNOWN, Source.NOTHING
    if measurement.offset is not None and reading is not None:
        covariance = at_axle(reading.pose_covariance, measurement, mounted)
        source = Source.CARRIED if measurement.carried else Source.MEMORY
    elif measurement.bearings is not None:
        source = Source.TWO_VIEWS
    return GoalEstimate(
        measurement.stamp_ns,
        measurement.bearings,
        measurement.covariance,
        measurement.offset,
        measurement.heading_error,
        covariance,
        (
            measurement.difference,
            measurement.difference_slope,
            measurement.difference_deviation,
        ),
        measurement.view_margins,
        mounted.mount,
        base,
        mounted.distance if mounted.is_ranged else math.nan,
        place,
        source,
        reason_of(measurement.reason),
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
