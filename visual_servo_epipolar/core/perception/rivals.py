"""
Rivals: both geometries of two views of a plane, until a straight way shows which of them is false.

What a view of a plane shows fits two geometries (Faugeras and Lustman 1988). In each the camera is
at a place and has a heading; a robot that drives straight goes where it heads in the true one
alone. Places are in units of the depth of the scene: nothing needs to know the way in metres.
"""

from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.perception.observation import Observation

DECISIVE = 9.0  # squared deviations by which a geometry must be the likelier one
USUAL_YAW = math.radians(1.0)  # deviation of the direction in which a camera is driven
NO_VIEWS = np.zeros((2, 5, 5))
FEWEST = 8  # views of the way
MOST_DEVIATION = math.radians(2.0)  # of the direction of the way, beyond which it tells nothing


@dataclass(frozen=True, eq=False)
class Rivals:
    """
    Both geometries along a ``way`` [m] of straight legs, the last of which is not over.

    ``headings``, (2,), are those of the last view, by which the next ones are distinguished [rad].
    ``moments``, (2, 5, 5), are sums over views of the leg of products of 1, right, ahead, heading
    and way; ``before``, (2,), is by how much legs before contradict each geometry. ``turn`` is the
    heading of the features as a whole at the beginning [rad].
    """

    headings: FloatArray
    moments: FloatArray
    turn: float
    way: float = 0.0
    before: FloatArray = field(default_factory=lambda: np.zeros(2))

    def misfits(self, yaw: float) -> FloatArray:
        """
        Return by how much each geometry contradicts a straight way, (2,), in squared deviations.

        The camera looks to the left of where it is driven by ``yaw`` [rad]. Zero while the way is
        too short to tell.
        """
        return self.before + [_misfit(moments, yaw) for moments in self.moments]

    def decided(self, yaw: float) -> int | None:
        """Return which geometry is left, 0 or 1; None while both may be right."""
        misfits = self.misfits(yaw)
        best = int(misfits.argmin())
        return best if misfits.all() and misfits[1 - best] - misfits[best] > DECISIVE else None


def begun(rivals: tuple[Bearings, ...], turn: float) -> Rivals:
    """Return what is known of ``rivals`` before the robot moves."""
    headings = np.array([each.heading_error for each in rivals])
    return Rivals(headings, NO_VIEWS, turn)


def in_order(rivals: tuple[Bearings, ...], before: Rivals) -> tuple[Bearings, ...]:
    """Return ``rivals`` of a view in the order that they had ``before``."""
    apart = [
        [abs(math.remainder(each.heading_error - heading, 2.0 * math.pi)) for each in rivals]
        for heading in before.headings.tolist()
    ]
    is_same = apart[0][0] + apart[1][1] <= apart[0][1] + apart[1][0]
    return rivals if is_same else rivals[::-1]


def followed(
    before: Rivals, rivals: tuple[Bearings, ...], observation: Observation, way: float
) -> Rivals:
    """Return what a ``way`` [m] straight on to one more view shows; ``rivals`` are in order."""
    way = before.way + abs(way)
    rows = np.array([[*_row(each, observation), way] for each in rivals])
    moments = before.moments + rows[:, :, None] * rows[:, None, :]
    headings = np.array([each.heading_error for each in rivals])
    return replace(before, headings=headings, moments=moments, way=way)


def turned(before: Rivals, rivals: tuple[Bearings, ...], yaw: float) -> Rivals:
    """Return what is known where the robot turns: the leg is over."""
    headings = np.array([each.heading_error for each in rivals])
    misfits = before.misfits(yaw)
    return replace(before, headings=headings, moments=NO_VIEWS, before=misfits)


def ahead_of_both(bearings: Bearings, observation: Observation) -> Bearings:
    """Return ``bearings`` by the sign with which the scene lies ahead of both cameras."""
    return bearings if _depth(bearings, observation) > 0.0 else bearings.reversed()


def _row(bearings: Bearings, observation: Observation) -> tuple[float, ...]:
    """Return 1, and where the camera is, right and ahead of the goal's, and its heading."""
    depth = _depth(bearings, observation)
    right, ahead = math.cos(bearings.psi) / depth, math.sin(bearings.psi) / depth
    return 1.0, right, ahead, bearings.heading_error


def _depth(bearings: Bearings, observation: Observation) -> float:
    """Return the median depth from the goal in baselines, negative by the other sign."""
    place = np.array([math.cos(bearings.psi), 0.0, math.sin(bearings.psi)])
    turned = observation.current @ rotation_desired_current(bearings.heading_error).T
    # A point is along z d of the photograph, and at the place plus along the ray turned.
    across = np.cross(observation.desired, turned)
    return median((np.cross(place, turned) * across).sum(1) / (across * across).sum(1))


def _misfit(moments: FloatArray, yaw: float) -> float:
    count = float(moments[0, 0])
    if count < FEWEST:
        return 0.0
    mean = moments[0, 1:] / count
    covariance = moments[1:, 1:] / count - np.outer(mean, mean)
    heading, way = float(mean[2]), float(covariance[3, 3])
    if way == 0.0:
        return 0.0
    # Along and to the left of where the robot heads in this geometry, over the way.
    along = np.array([-math.sin(heading - yaw), math.cos(heading - yaw)])
    left = np.array([-along[1], along[0]])
    aside, ahead = float(left @ covariance[:2, 3]) / way, float(along @ covariance[:2, 3]) / way
    spread = max(float(left @ covariance[:2, :2] @ left) - aside * aside * way, 0.0)
    variance = spread / ((count - 2.0) * way * ahead * ahead)
    if not variance < MOST_DEVIATION**2:
        return 0.0
    return math.atan(aside / ahead) ** 2 / (variance + USUAL_YAW**2)
