"""Path estimate: where beside the path the robot is, by commands and by trusted views."""

import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import compose, STANDSTILL, Twist
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.routes.path import PathPoint, TaughtPath
from visual_servo_epipolar.core.routes.places import Place
from visual_servo_epipolar.core.routes.route import Bridge
from visual_servo_epipolar.core.routes.structure import ViewPose
from visual_servo_epipolar.core.stamps import NANOSECONDS

GATE = 4.0  # deviations of a view from what was predicted, from which it is not believed
GATE_FLOOR = np.array([0.02, 0.02, 0.01])  # that they are at least [m, m, rad]
SLIP_NOISE = 0.03  # of the true way against the commanded one [m/sqrt(m)]
PLACE_NOISE = np.array([0.02, 0.02, 0.02])  # of way, offset and turn of a place [m, m, rad]
OBEYED_AFTER, LEAST_OBEYED = 0.5, 0.2  # way [m] of commands of which the view must see a share
TURN_NOISE = 0.02  # of the true turn against the commanded one [rad/sqrt(s)]
SLIDE_NOISE = 0.002  # of the base across its heading [m/sqrt(m)]
BIAS_NOISE = 0.01  # by which the curvature of the wheels changes [1/m/sqrt(m)]
FIRST = np.diag([0.3**2, 0.3**2, 0.03**2])
LEAST = np.array([0.0015, 0.0006])  # deviations of one view beside its own: the seam [m, rad]


class PathMeasurement(NamedTuple):
    """Where a view is beside the path, with the covariance, (3, 3), of way, offset and turn."""

    point: PathPoint
    covariance: FloatArray
    inliers: int


class PathEstimate:
    """
    Where on the ``way`` [m] and beside the path a robot is: a filter of commands and views.

    ``state``, (3,): offset to the left [m], turn to the left [rad], and the curvature that the
    base adds to what is commanded [1/m], with ``covariance``, (3, 3). It begins at a ``place``, or
    unsure (``is_placed``) until a view tells. Commands act after ``latency`` [s]; ``disobeyed``
    says that the base does not do as commanded.
    """

    def __init__(self, way: float, latency: float, place: Place | None = None) -> None:
        self.way, self.latency, self.disobeyed = way, latency, ''
        self.state, self.covariance, self.is_placed = np.zeros(3), FIRST.copy(), place is not None
        if place is not None:
            self.state[:2] = place.offset, place.turn
            squares = np.array([place.deviation**2, place.pose.covariance[2, 2]])
            self.covariance[:2, :2] = np.diag(PLACE_NOISE[1:] ** 2 + squares)
        self._commanded, self._marked = 0.0, way  # since the base was last seen to obey [m]
        # Where a view was believed at last, and what is unsure since then.
        self._seen_way, self.way_variance = way, float(PLACE_NOISE[0] ** 2)
        self._sent = CommandsSent()
        self._curvature = 0.0

    @property
    def deviation(self) -> float:
        """Deviation of the offset [m]."""
        return math.sqrt(self.covariance[0, 0])

    def sent(self, stamp_ns: int, twist: Twist) -> None:
        """Note that the base was sent a ``twist`` at ``stamp_ns``."""
        self._sent = self._sent.after(stamp_ns, twist)

    def halted(self, stamp_ns: int, *, unsent: bool) -> None:
        """Note a command to stand at ``stamp_ns``; the last twist was ``unsent``."""
        if unsent or self._sent.stamps[-1:] == (stamp_ns,):  # it does not act at all
            self._sent = CommandsSent(self._sent.stamps[:-1], self._sent.twists[:-1])
        self.sent(stamp_ns, STANDSTILL)

    def continued(self, point: PathPoint, bridge: Bridge | None) -> None:
        """Go on at a ``point`` beside another path, to which a ``bridge`` leads, if any."""
        if bridge is not None:
            self.covariance += np.diag([bridge.deviation**2, bridge.turn_deviation**2, 0.0])
        self.way, self.state = point.way, np.array([point.offset, point.turn, self.state[2]])

    def pose_in(self, path: TaughtPath) -> FloatArray:
        """Return the pose in axes of the key view of a ``path``, (3,)."""
        offset, turn, _ = self.state.tolist()
        return compose(path.pose_at(self.way), np.array([0.0, offset, turn]))

    def predict(self, start_ns: int, end_ns: int) -> None:
        """Move on by what the base was commanded between two images."""
        if self.is_placed and end_ns > start_ns:
            for span, twist in self._sent.acting(start_ns, end_ns, self.latency):
                self.move(twist, span)

    def move(self, twist: Twist, dt: float) -> None:
        """Move on by a ``twist`` for ``dt`` [s]."""
        way = twist.linear * dt
        slope = np.array([[1.0, way, 0.5 * way * way], [0.0, 1.0, way], [0.0, 0.0, 1.0]])
        noise = np.array([SLIDE_NOISE**2 * abs(way), TURN_NOISE**2 * dt, BIAS_NOISE**2 * abs(way)])
        self.covariance = slope @ self.covariance @ slope.T + np.diag(noise)
        self.state = self._moved(self.state, twist, dt)
        self.way += way
        self._commanded += abs(way)
        self.way_variance += SLIP_NOISE**2 * abs(way)

    def _moved(self, state: FloatArray, twist: Twist, dt: float) -> FloatArray:
        offset, turn, bias = state.tolist()
        rate = twist.angular + twist.linear * (bias - self._curvature)
        middle = turn + 0.5 * rate * dt
        return np.array([offset + twist.linear * math.sin(middle) * dt, turn + rate * dt, bias])

    def when_told(self, now_ns: int) -> tuple[FloatArray, float]:
        """Return the state and the way when the next command begins to act."""
        state, way, late_ns = self.state, self.way, round(self.latency * NANOSECONDS)
        for span, twist in self._sent.acting(now_ns, now_ns + late_ns, self.latency):
            state, way = self._moved(state, twist, span), way + twist.linear * span
        return state, way

    def trouble(self, measured: PathMeasurement) -> str:
        """Return that a view is farther off what was predicted than chance explains; or ''."""
        if not self.is_placed:  # a robot that was carried away is looked for anew
            return ''
        point, (offset, turn, _) = measured.point, self.state.tolist()
        # It may have driven less than commanded: that is for ``disobeyed``.
        least, most = sorted((self._seen_way, self.way))
        slip = point.way - min(max(point.way, least), most)
        off = np.array([slip, point.offset - offset, point.turn - turn])
        covariance = measured.covariance + np.diag((GATE_FLOOR / GATE) ** 2)
        covariance[0, 0] += self.way_variance
        covariance[1:, 1:] += self.covariance[:2, :2]
        if float(off @ np.linalg.solve(covariance, off)) <= GATE**2:
            return ''
        return (
            f'the view is {off[0]:+.3f} m along the way, {off[1]:+.3f} m beside it and '
            f'{off[2]:+.3f} rad off what was predicted, {GATE:g} deviations are believed'
        )

    def update(self, measured: PathMeasurement) -> None:
        """Take in where a view that is believed is."""
        point, noise = measured.point, measured.covariance[1:, 1:] + np.diag(LEAST**2)
        gain = self.covariance[:, :2] @ np.linalg.inv(self.covariance[:2, :2] + noise)
        self.state = self.state + gain @ (np.array([point.offset, point.turn]) - self.state[:2])
        after = self.covariance - gain @ self.covariance[:2]
        self.covariance, self.is_placed = 0.5 * (after + after.T), True
        self.way, self._curvature = point.way, point.curvature
        self._seen_way, self.way_variance = point.way, 0.0
        if self._commanded > OBEYED_AFTER:
            moved = abs(self.way - self._marked)
            if moved < LEAST_OBEYED * self._commanded:
                self.disobeyed = (
                    f'the base was commanded to drive {self._commanded:.2f} m, and the view has '
                    f'moved by {moved:.2f} m; look at its wheels, and for others on cmd_vel'
                )
            self._commanded, self._marked = 0.0, self.way


def beside(path: TaughtPath, found: ViewPose, near: float) -> PathMeasurement:
    """Return where a placed view is beside a ``path``, not far from ``near`` [m] on it."""
    point = path.beside(found.pose, near)
    heading = path.pose_at(point.way)[2]
    cos, sin = math.cos(heading), math.sin(heading)
    rows = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return PathMeasurement(point, rows @ found.covariance @ rows.T, found.inliers)
