"""Path estimate: where beside the path the robot is, by commands and by trusted views."""

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import compose, STANDSTILL, Twist
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.routes.following.steering import FIRST, LateralFilter
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


class PathMeasurement(NamedTuple):
    """Where a view is beside the path, with the covariance, (3, 3), of way, offset and turn."""

    point: PathPoint
    covariance: FloatArray
    inliers: int


class PathEstimate:
    """
    Where on the ``way`` [m] and beside the path a robot is; ``lateral`` is None until a view says.

    Commands act after ``latency`` [s]. ``disobeyed`` says that the base does not do as
    commanded.
    """

    def __init__(self, way: float, latency: float, lateral: LateralFilter | None) -> None:
        self.way, self.lateral, self.disobeyed = way, lateral, ''
        self.latency = latency
        self._commanded, self._marked = 0.0, way  # since the base was last seen to obey [m]
        # Where a view was believed at last, and what is unsure since then.
        self._seen_way, self._way_variance = way, float(PLACE_NOISE[0] ** 2)
        self._sent = CommandsSent()
        self._curvature = 0.0

    def sent(self, stamp_ns: int, twist: Twist) -> None:
        """Note that the base was sent a ``twist`` at ``stamp_ns``."""
        self._sent = self._sent.after(stamp_ns, twist)

    def halted(self, stamp_ns: int, *, unsent: bool) -> None:
        """Note a command to stand at ``stamp_ns``; the last twist was ``unsent``."""
        if unsent or self._sent.stamps[-1:] == (stamp_ns,):  # it does not act at all
            self._sent = CommandsSent(self._sent.stamps[:-1], self._sent.twists[:-1])
        self.sent(stamp_ns, STANDSTILL)

    def carried(self, T: FloatArray, path: TaughtPath, other: TaughtPath, by: float) -> None:
        """
        Go on beside another path, whose ways are longer ``by`` a length [m].

        ``T``, (3,), is the pose of the key view of this ``path`` in axes of that of the other one.
        """
        pose = compose(T, self.pose_in(path))
        self.way += by
        self._seen_way, self._marked = self._seen_way + by, self._marked + by
        if self.lateral is not None:
            self.continued(other.beside(pose, self.way))

    def continued(self, point: PathPoint, bridge: Bridge | None = None) -> None:
        """Go on at a ``point`` beside another path, to which a ``bridge`` leads, if any."""
        assert self.lateral is not None
        covariance = self.lateral.covariance
        if bridge is not None:
            squares = bridge.deviation**2, bridge.turn_deviation**2, 0.0
            covariance = covariance + np.diag(squares)
        state = np.array([point.offset, point.turn, self.lateral.state[2]])
        self.way, self.lateral = point.way, LateralFilter(state, covariance)

    def pose_in(self, path: TaughtPath) -> FloatArray:
        """Return the pose in axes of the key view of a ``path``, (3,)."""
        pose = path.pose_at(self.way)
        if self.lateral is None:
            return pose
        offset, turn, _ = self.lateral.state.tolist()
        return compose(pose, np.array([0.0, offset, turn]))

    def predict(self, start_ns: int, end_ns: int) -> None:
        """Move on by what the base was commanded between two images."""
        if self.lateral is None or end_ns <= start_ns:
            return
        for span, twist in self._sent.acting(start_ns, end_ns, self.latency):
            self.lateral = self.lateral.moved(twist.linear, twist.angular, self._curvature, span)
            self.way += twist.linear * span
            self._commanded += abs(twist.linear) * span
            self._way_variance += SLIP_NOISE**2 * abs(twist.linear) * span

    def when_told(self, at: LateralFilter, now_ns: int) -> tuple[LateralFilter, float]:
        """Return offset and turn, from ``at`` on, and way, when the next command begins to act."""
        way = self.way
        late_ns = round(self.latency * NANOSECONDS)
        for span, twist in self._sent.acting(now_ns, now_ns + late_ns, self.latency):
            state = at.predicted(twist.linear, twist.angular, self._curvature, span)
            at, way = replace(at, state=state), way + twist.linear * span
        return at, way

    def trouble(self, measured: PathMeasurement) -> str:
        """Return that a view is where the robot cannot be; or ''."""
        if self.lateral is None:  # a robot that was carried away is looked for anew
            return ''
        # It may have driven less than commanded: that is for ``disobeyed``.
        least, most = sorted((self._seen_way, self.way))
        slip = measured.point.way - min(max(measured.point.way, least), most)
        return beyond_gate(self.lateral, measured, slip, self._way_variance)

    def update(self, measured: PathMeasurement) -> None:
        """Take in where a view that is believed is."""
        point = measured.point
        before = LateralFilter() if self.lateral is None else self.lateral
        self.lateral = before.seen(point.offset, point.turn, measured.covariance[1:, 1:])
        self.way, self._curvature = point.way, point.curvature
        self._seen_way, self._way_variance = point.way, 0.0
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


def beyond_gate(at: LateralFilter, measured: PathMeasurement, slip: float, variance: float) -> str:
    """
    Return that a view is farther off what was predicted than chance explains; or ''.

    It is ``slip`` [m] along the way from where the base can be, which has a ``variance``.
    """
    offset, turn, _ = at.state.tolist()
    off = np.array([slip, measured.point.offset - offset, measured.point.turn - turn])
    covariance = measured.covariance + np.diag((GATE_FLOOR / GATE) ** 2)
    covariance[0, 0] += variance
    covariance[1:, 1:] += at.covariance[:2, :2]
    if float(off @ np.linalg.solve(covariance, off)) <= GATE**2:
        return ''
    return (
        f'the view is {off[0]:+.3f} m along the way, {off[1]:+.3f} m beside it and '
        f'{off[2]:+.3f} rad off what was predicted, {GATE:g} deviations are believed'
    )


def place_filter(place: Place) -> LateralFilter:
    """Return the filter that begins where a ``place`` is beside the path."""
    covariance = FIRST.copy()
    covariance[:2, :2] = np.diag(PLACE_NOISE[1:] ** 2)
    covariance[0, 0] += place.deviation**2
    covariance[1, 1] += place.pose.covariance[2, 2]
    return LateralFilter(np.array([place.offset, place.turn, 0.0]), covariance)
