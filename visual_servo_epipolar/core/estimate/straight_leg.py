"""
Straight legs of step 2: the yaw of the camera on the base, by a memory of views.

A camera with a yaw ends beside the line that the robot follows. Bearings show some degrees of yaw
(``extrinsics``); positions known to millimetres show a tenth of a degree, and so a principal point
that is off by a few pixels, which acts alike.
"""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import Extrinsics
from visual_servo_epipolar.core.estimate.extrinsics_update import with_yaw
from visual_servo_epipolar.core.mapping.localization import MapMeasurement
from visual_servo_epipolar.core.rigs.fixed_mount import axle_offset

LEG_M = 0.25  # over which a direction is measured
OF_BOTH = 0.3  # of deviations of places: most of what they are off by is the same at both ends
LEAST_LEVER, LEVER = 0.01, 0.1  # by which a turn may swing the camera aside of where it is [m]
LEAST_DEVIATION = 5e-4  # of the mean heading of a leg [rad]
MOST_DEVIATION = math.radians(0.5)  # of what a leg tells: far off a memory may be wrong by more
MOST_CURVED = 0.3  # headings of a leg may differ by [rad]


@dataclass(frozen=True, slots=True)
class StraightLeg:
    """
    Leg of step 2 from where a memory of views has the camera, ``x`` (right), ``y`` (ahead) [m].

    Both are in axes of the goal's camera; ``deviation`` is that of x [m], ``heading`` the error
    there [rad]; ``travel`` since is negative backward [m], ``turned`` the integral of the heading
    error over it [rad m]. ``weight`` [1/rad^2] and ``weighted`` [1/rad] are what legs before gave.
    """

    x: float
    y: float
    deviation: float
    heading: float
    travel: float = 0.0
    turned: float = 0.0
    weight: float = 0.0
    weighted: float = 0.0

    def extended(self, heading: float, travel: float) -> 'StraightLeg':
        """Return the leg after ``travel`` [m], which ends at a ``heading`` error [rad]."""
        turned = self.turned + heading * travel
        return replace(self, travel=self.travel + travel, turned=turned)

    def yaw(self, end: 'StraightLeg', mount: FloatArray, lever: float) -> tuple[float, float]:
        """
        Return by how much the camera looks to the left of where it is driven, and the deviation.

        Both are in rad; the leg ends where ``end`` begins. The axle is where the ``mount`` that is
        likely by now, (3,), lies off the camera, at both ends; ``lever`` is the deviation of
        how far the camera is ahead of it [m].
        """
        x, y = axle_offset((self.x, self.y), self.heading, mount)
        right, ahead = axle_offset((end.x, end.y), end.heading, mount)
        right, ahead = right - x, ahead - y
        way = math.hypot(right, ahead)
        if not way > 0.5 * LEG_M or abs(end.heading - self.heading) > MOST_CURVED:
            return 0.0, math.inf
        forward = math.copysign(1.0, self.travel)
        driven = math.atan2(-forward * right, forward * ahead)
        swing = lever * abs(end.heading - self.heading)
        aside = math.hypot(OF_BOTH * self.deviation, OF_BOTH * end.deviation, swing) / way
        if aside > MOST_DEVIATION:
            return 0.0, math.inf
        return self.turned / self.travel - driven, math.hypot(aside, LEAST_DEVIATION)

    def followed_by(self, end: 'StraightLeg', yaw: float, deviation: float) -> 'StraightLeg':
        """Return the leg that begins at the ``end`` of this one, which gave a ``yaw`` [rad]."""
        measured = 1.0 / (deviation * deviation)
        return replace(end, weight=self.weight + measured, weighted=self.weighted + measured * yaw)

    @property
    def measured(self) -> tuple[float, float]:
        """The mean yaw of all legs by now and its deviation [rad], which is inf of none."""
        if not self.weight > 0.0:
            return 0.0, math.inf
        return self.weighted / self.weight, 1.0 / math.sqrt(self.weight)


def straight_on(
    leg: StraightLeg | None, reading: MapMeasurement | None, travel: float, belief: Extrinsics
) -> tuple[StraightLeg | None, Extrinsics]:
    """Return the ``leg`` after ``travel`` [m], and the belief by the yaw that all legs tell."""
    if reading is None:
        return None, belief
    heading = reading.heading_error
    place = reading.lateral, reading.longitudinal
    here = StraightLeg(*place, reading.lateral_deviation, heading)
    if leg is None:
        return here, belief
    leg = leg.extended(heading, travel)
    if abs(leg.travel) < LEG_M:
        return leg, belief
    lever = min(max(belief.lever_deviation, LEAST_LEVER), LEVER)
    measured = leg.yaw(here, belief.likely, lever)
    following = leg.followed_by(here, *measured)
    # What is believed by now learns from each leg; it takes all of them to begin to.
    measured = measured if belief.believed else following.measured
    return following, with_yaw(belief, *measured)
