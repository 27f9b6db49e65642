"""Ways through the storey: straights and arcs, and a driver who keeps to them by ground truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Pose, Twist, wrap_angle

RADIUS = 1.15  # of corners [m]
SPACING = 0.01  # of points on a way [m]
LOOKAHEAD = 0.35  # of the driver [m]

# Corners of ways (x, y) [m]: through doors, along corridors, and across themselves.
WAYS: Mapping[str, Sequence[tuple[float, float]]] = {
    'short': ((3.0, -7.6), (3.0, -1.2), (9.5, -1.2), (9.5, 3.5)),
    'loop': ((3.2, -7.2), (5.4, -7.2), (5.4, -3.8), (1.6, -3.8), (1.6, -7.2), (3.2, -7.2)),
    'rooms': (
        (3.0, -7.6),
        (3.0, -1.2),
        (9.5, -1.2),
        (9.5, 6.0),
        (2.5, 6.0),
        (2.5, 10.2),
        (8.0, 10.2),
    ),
    'ring': ((4.0, -1.2), (15.2, -1.2), (15.2, 10.2), (-1.2, 10.2), (-1.2, -1.2), (4.0, -1.2)),
    'long': (
        (11.0, -7.6),
        (11.0, -1.2),
        (-1.2, -1.2),
        (-1.2, 10.2),
        (15.2, 10.2),
        (15.2, -1.2),
        (9.5, -1.2),
        (9.5, 6.0),
        (2.5, 6.0),
        (2.5, 10.2),
        (8.0, 10.2),
    ),
}


@dataclass(frozen=True, eq=False)
class DrivenWay:
    """Points along a way, (M, 2), SPACING apart or nearly."""

    points: FloatArray

    @cached_property
    def length(self) -> FloatArray:
        """Way to each point [m], (M,)."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def start(self) -> Pose:
        """Pose at its beginning."""
        ahead = self.points[1] - self.points[0]
        x, y = self.points[0].tolist()
        return Pose(x, y, math.atan2(ahead[1], ahead[0]))

    def nearest(self, x: float, y: float, near: int, reach: int = 200) -> int:
        """Return the number of the nearest point, ``reach`` points around number ``near``."""
        first = max(near - reach, 0)
        part = self.points[first : near + reach + 1] - [x, y]
        return first + int(np.argmin((part * part).sum(1)))

    def offset(self, pose: Pose, near: int) -> tuple[int, float]:
        """Return the nearest point's number, and how far left of the way a pose is [m]."""
        k = self.nearest(pose.x, pose.y, near)
        before, after = self.points[max(k - 1, 0)], self.points[min(k + 1, len(self.points) - 1)]
        tangent = (after - before) / np.linalg.norm(after - before)
        away = np.array([pose.x, pose.y]) - self.points[k]
        return k, float(tangent[0] * away[1] - tangent[1] * away[0])


def way_named(name: str) -> DrivenWay:
    """Return the way of that name, with rounded corners; KeyError if there is none."""
    return rounded(WAYS[name])


def rounded(corners: Sequence[tuple[float, float]]) -> DrivenWay:
    """Return the way along straights, with corners rounded by RADIUS."""
    places = [np.array(corner) for corner in corners]
    parts, at = [], places[0]
    for before, corner, after in zip(places[:-2], places[1:-1], places[2:], strict=True):
        first = (corner - before) / np.linalg.norm(corner - before)
        second = (after - corner) / np.linalg.norm(after - corner)
        turn = wrap_angle(math.atan2(second[1], second[0]) - math.atan2(first[1], first[0]))
        cut = RADIUS * math.tan(0.5 * abs(turn))
        entry = corner - cut * first
        side = math.copysign(1.0, turn)
        centre = entry + RADIUS * side * np.array([-first[1], first[0]])
        parts.append(_straight(at, entry))
        angles = np.arange(0.0, abs(turn), SPACING / RADIUS)
        begin = entry - centre
        cos, sin = np.cos(side * angles), np.sin(side * angles)
        turned = np.stack([cos * begin[0] - sin * begin[1], sin * begin[0] + cos * begin[1]], 1)
        parts.append(centre + turned)
        at = corner + cut * second
    parts.append(_straight(at, places[-1]))
    parts.append(places[-1][None])
    return DrivenWay(np.concatenate(parts))


def _straight(start: FloatArray, end: FloatArray) -> FloatArray:
    count = max(int(np.linalg.norm(end - start) / SPACING), 1)
    return np.asarray(start + np.arange(count)[:, None] / count * (end - start))


class Driver:
    """Drives along a way by pure pursuit of ground truth, as a person with a joystick would."""

    def __init__(self, way: DrivenWay, speed: float) -> None:
        self._way, self._speed, self._near = way, speed, 0

    def twist(self, pose: Pose) -> Twist:
        """Return the command at a pose."""
        self._near = self._way.nearest(pose.x, pose.y, self._near)
        ahead = min(self._near + round(LOOKAHEAD / SPACING), len(self._way.points) - 1)
        x, y = (self._way.points[ahead] - [pose.x, pose.y]).tolist()
        distance = max(math.hypot(x, y), 1e-3)
        bearing = wrap_angle(math.atan2(y, x) - pose.theta)
        left = float(self._way.length[-1] - self._way.length[self._near])
        speed = min(self._speed, math.sqrt(2.0 * 0.25 * max(left - 0.02, 0.0)))
        return Twist(speed, 2.0 * speed * math.sin(bearing) / max(distance, LOOKAHEAD))

    @property
    def is_there(self) -> bool:
        """Whether the end is reached."""
        return float(self._way.length[-1] - self._way.length[self._near]) < 0.03
