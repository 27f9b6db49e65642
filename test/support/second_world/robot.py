"""A robot of another make: two lagging wheels, a dead time, a camera on a mast; its judge."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np

STEP = 0.005  # of the integration [s]
TRACK = 0.42  # between the wheels [m]
LAG = 0.12  # time constant of a wheel [s]
DEAD_TIME = 0.09  # from a command to the motors [s]
RIGHT_WHEEL = 1.01  # of the radius that the motors believe in
GOAL = (0.0, 0.0, 0.5 * math.pi)

Place = tuple[float, float, float]


@dataclass(frozen=True)
class Mast:
    """Where the camera sits [m], and its angles [rad]: down, clockwise, to the left."""

    height: float = 0.35
    ahead: float = 0.12
    aside: float = 0.04
    tilt: float = 0.0
    roll: float = 0.0
    yaw: float = 0.0

    def camera(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Return the axes right, down, forward as columns, (3, 3), and the centre, (3,)."""
        x, y, heading = place
        ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
        aside = np.array([-ahead[1], ahead[0], 0.0])
        up = np.array([0.0, 0.0, 1.0])
        centre = np.array([x, y, self.height]) + self.ahead * ahead + self.aside * aside
        look = math.cos(self.yaw) * ahead + math.sin(self.yaw) * aside
        level = np.cross(look, up)
        forward = math.cos(self.tilt) * look - math.sin(self.tilt) * up
        right = math.cos(self.roll) * level + math.sin(self.roll) * np.cross(forward, level)
        return np.column_stack([right, np.cross(forward, right), forward]), centre


@dataclass
class Robot:
    """Obeys commands as late and as crookedly as its motors do; Heun's method, step by step."""

    place: Place
    wheels: np.ndarray = field(default_factory=lambda: np.zeros(2))  # left and right [m/s]
    late: deque[tuple[float, float]] = field(
        default_factory=lambda: deque([(0.0, 0.0)] * round(DEAD_TIME / STEP))
    )

    def drive(self, linear: float, angular: float, seconds: float) -> None:
        """Obey a command [m/s, rad/s] for so long."""
        for _ in range(round(seconds / STEP)):
            self.late.append((linear, angular))
            wanted, turn = self.late.popleft()
            goal = np.array([wanted - 0.5 * TRACK * turn, wanted + 0.5 * TRACK * turn])
            self.wheels = self.wheels + STEP / LAG * (goal - self.wheels)
            self._move(float(self.wheels[0]), RIGHT_WHEEL * float(self.wheels[1]))

    def _move(self, left: float, right: float) -> None:
        x, y, heading = self.place
        speed, turned = 0.5 * (left + right), heading + STEP * (right - left) / TRACK
        x += 0.5 * STEP * speed * (math.cos(heading) + math.cos(turned))
        y += 0.5 * STEP * speed * (math.sin(heading) + math.sin(turned))
        self.place = x, y, turned


@dataclass(frozen=True)
class Moment:
    """One frame: the true place, the bearings that were acted on [rad], whether it drove."""

    place: Place
    bearings: tuple[float, float] | None
    drives: bool


def excursion(moments: Sequence[Moment]) -> float:
    """Return the largest distance from the goal over the first."""
    distances = [math.hypot(*moment.place[:2]) for moment in moments]
    return max(distances) / distances[0]


def wrong_geometry_s(moments: Sequence[Moment], mast: Mast, period: float) -> float:
    """Return for how long it drove while bearings were more than 10 deg off; not within 2 cm."""
    return period * sum(moment.drives and _is_wrong(moment, mast) for moment in moments)


def _is_wrong(moment: Moment, mast: Mast) -> bool:
    (_, here), (_, goal) = mast.camera(moment.place), mast.camera(GOAL)
    way = complex(*(goal - here)[:2])
    if moment.bearings is None or abs(way) < 0.02:
        return False
    current, desired = (np.exp(1j * angle) for angle in moment.bearings)
    # To the right of the heading is clockwise, against the angles of the plane.
    seen_here = np.exp(1j * (moment.place[2] + mast.yaw)) / current
    seen_there = np.exp(1j * (GOAL[2] + mast.yaw)) / desired
    errors = abs(np.angle(seen_here / way)), abs(np.angle(-seen_there / way))
    return bool(max(errors) > math.radians(10.0))
