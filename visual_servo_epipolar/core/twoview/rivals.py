"""
Rivals: both geometries of two views of a plane, until the way driven shows which of them is false.

What a view of a plane shows fits two geometries (Faugeras and Lustman 1988). In each the camera is
at a place and has a heading; a robot goes where it heads in the true one alone. Places are in
units of the depth of the scene: their scale is free.
"""

from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import ComplexArray, FloatArray, median
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.twoview.observation import Observation

DECISIVE = 9.0  # squared deviations by which a geometry must be the likelier one
USUAL_YAW = math.radians(1.0)  # deviation of the direction in which a camera is driven
CORRELATION = 4.0  # places share the photograph: so many tell as much as one
FEWEST = 8  # views of the way


@dataclass(frozen=True, eq=False)
class Rivals:
    """
    Both geometries along a ``way`` [m].

    ``headings``, (2,), are those of the last view, by which the next ones are distinguished [rad];
    ``driven``, (2,), is where the camera has been driven to in each, ahead + i left of the goal's
    axes [m]. ``moments``, (2, 3, 3), are sums over views of products of 1, place and ``driven``.
    ``turn`` is the heading of the features as a whole at the beginning [rad].
    """

    headings: FloatArray
    turn: float
    way: float = 0.0
    driven: ComplexArray = field(default_factory=lambda: np.zeros(2, complex))
    moments: ComplexArray = field(default_factory=lambda: np.zeros((2, 3, 3), complex))

    @property
    def misfits(self) -> FloatArray:
        """By how much the way contradicts each geometry, (2,), in squared deviations."""
        return np.array([_misfit(moments) for moments in self.moments])

    @property
    def decided(self) -> int | None:
        """Which geometry is left, 0 or 1; None while both may be right."""
        first, second = self.misfits.tolist()
        return int(first > second) if abs(first - second) > DECISIVE else None


def begun(rivals: tuple[Bearings, ...], turn: float) -> Rivals:
    """Return what is known of ``rivals`` before the robot moves."""
    return Rivals(np.array([each.heading_error for each in rivals]), turn)


def in_order(rivals: tuple[Bearings, ...], before: Rivals) -> tuple[Bearings, ...]:
    """Return ``rivals`` of a view in the order that they had ``before``."""
    apart = [
        [abs(math.remainder(each.heading_error - heading, 2.0 * math.pi)) for each in rivals]
        for heading in before.headings.tolist()
    ]
    is_same = apart[0][0] + apart[1][1] <= apart[0][1] + apart[1][0]
    return rivals if is_same else rivals[::-1]


def followed(
    before: Rivals,
    rivals: tuple[Bearings, ...],
    observation: Observation,
    way: float,
    mount: FloatArray,
) -> Rivals:
    """
    Return what a ``way`` [m] to one more view shows; ``rivals`` are in order.

    The camera looks to the left of where it is driven by a yaw [rad], and is ahead and left of the
    axle in its own axes [m]: ``mount``, (3,).
    """
    headings = np.array([each.heading_error for each in rivals])
    first, last = np.exp(1j * before.headings), np.exp(1j * headings)
    middle, (yaw, *lever) = (first + last) / abs(first + last), mount.tolist()
    driven = before.driven + way * middle * np.exp(-1j * yaw) + (last - first) * complex(*lever)
    rows = np.array(
        [(1.0, _place(each, observation), at) for each, at in zip(rivals, driven, strict=True)]
    )
    moments = before.moments + rows[:, :, None] * rows[:, None, :].conj()
    return replace(
        before, headings=headings, way=before.way + abs(way), driven=driven, moments=moments
    )


def ahead_of_both(bearings: Bearings, observation: Observation) -> Bearings:
    """Return ``bearings`` by the sign with which the scene lies ahead of both cameras."""
    return bearings if _depth(bearings, observation) > 0.0 else bearings.reversed()


def _place(bearings: Bearings, observation: Observation) -> complex:
    """Return where the camera is, ahead + i left of the goal's, in units of the depth."""
    depth = _depth(bearings, observation)
    return complex(math.sin(bearings.psi), -math.cos(bearings.psi)) / depth


def _depth(bearings: Bearings, observation: Observation) -> float:
    """Return the median depth from the goal in baselines, negative by the other sign."""
    place = np.array([math.cos(bearings.psi), 0.0, math.sin(bearings.psi)])
    turned = observation.current @ rotation_desired_current(bearings.heading_error).T
    # A point is along z d of the photograph, and at the place plus along the ray turned.
    across = np.cross(observation.desired, turned)
    return median((np.cross(place, turned) * across).sum(1) / (across * across).sum(1))


def _misfit(moments: ComplexArray) -> float:
    """Return by how much places are turned against where the camera was driven to, squared."""
    count = moments[0, 0].real
    covariance = moments[1:, 1:] - np.outer(moments[1:, 0], moments[0, 1:]) / max(count, 1.0)
    spread, way = covariance[0, 0].real, covariance[1, 1].real
    if count < FEWEST or not way > 0.0:
        return 0.0
    scale = covariance[0, 1] / way  # place = scale driven + a constant, turned where it is false
    square = abs(scale) ** 2
    left = max(spread - square * way, 0.0) * CORRELATION / (2.0 * count - 4.0)
    return float(np.angle(scale) ** 2 / (left / (square * way) + USUAL_YAW**2))
