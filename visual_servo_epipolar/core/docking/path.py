"""The driven path: where the base was at the time of an image, by odometry or by commands."""

from bisect import bisect_right
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import arc, motion_between, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.geometry.planar_poses import relative_pose
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between

KEPT_S = 3.0  # of the path: no image is older
LONGEST_STEP_S = 1.0  # between two messages of odometry, else the path begins anew
FASTEST, FASTEST_TURN = 5.0, 12.0  # [m/s, rad/s] what is faster is a leap
LEAST_WAY, LEAST_TURN = 3e-4, 1e-4  # deviations of a step beside its own [m, rad]


@dataclass(frozen=True, slots=True, eq=False)
class PathPlace:
    """
    Where the base was: ``pose``, (3,), in the frame of the path, at ``stamp_ns``.

    ``way`` [m] and ``turn`` [rad] are all that was driven since ``epoch`` began, without sign:
    what the path is uncertain by grows with them.
    """

    stamp_ns: int
    pose: FloatArray
    way: float = 0.0
    turn: float = 0.0
    epoch: int = 0


def uncertainty(before: PathPlace, after: PathPlace, deviation: float) -> FloatArray:
    """
    Return the covariance, (3, 3), of the motion between two places, in axes of the first.

    Way and heading are random walks of ``deviation`` a metre, the heading a radian as well: half
    of what the heading errs by on the way moves the end aside.
    """
    way, turn = after.way - before.way, after.turn - before.turn
    x, y, _ = relative_pose(before.pose, after.pose)
    along = deviation**2 * way + LEAST_WAY**2
    heading = deviation**2 * (way + turn) + LEAST_TURN**2
    length = math.hypot(x, y)
    c, s = (x / length, y / length) if length > 0.0 else (1.0, 0.0)
    lever = np.array([-s, c]) * length
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = along * np.outer([c, s], [c, s]) + heading / 3.0 * np.outer(lever, lever)
    covariance[:2, :2] += LEAST_WAY**2 * np.eye(2)
    covariance[:2, 2] = covariance[2, :2] = 0.5 * heading * lever
    covariance[2, 2] = heading
    return covariance


class Path:
    """
    Places of the base in order of time, from ``add_pose`` (odometry) or ``add_twist`` (commands).

    A stamp that does not advance, a gap or a leap begins a new ``epoch``: what was driven before
    says nothing any more.
    """

    def __init__(self, *, command_timeout: float = 0.5) -> None:
        self.epoch = 0
        self._timeout = command_timeout
        self._places: list[PathPlace] = []
        self._twist = STANDSTILL

    @property
    def last_ns(self) -> int | None:
        """Stamp of the newest place, None of an empty path."""
        return self._places[-1].stamp_ns if self._places else None

    def add_pose(self, stamp_ns: int, pose: Pose) -> None:
        """Take in odometry."""
        here = np.array([pose.x, pose.y, pose.theta])
        if self._places and self._leaps(stamp_ns, here):
            self.epoch, self._places, self._twist = self.epoch + 1, [], STANDSTILL
        if not self._places:
            self._places = [PathPlace(stamp_ns, here, epoch=self.epoch)]
            return
        last = self._places[-1]
        dt = seconds_between(last.stamp_ns, stamp_ns)
        way, turn = motion_between(Pose(*last.pose.tolist()), pose)
        self._twist = Twist(way / dt, turn / dt)
        self._append(stamp_ns, here)

    def add_twist(self, stamp_ns: int, twist: Twist) -> None:
        """Take in a command, obeyed from now on until the next, or until it is too old."""
        if self._places and stamp_ns < self._places[-1].stamp_ns:
            self.epoch, self._places = self.epoch + 1, []
        if not self._places:
            self._places = [PathPlace(stamp_ns, np.zeros(3), epoch=self.epoch)]
        else:
            self._append(stamp_ns, self._driven(stamp_ns))
        self._twist = twist

    def at(self, stamp_ns: int, *, predict: bool = False) -> PathPlace | None:
        """Return the place at a stamp, None beyond the path, unless it may ``predict`` a while."""
        if not self._places or stamp_ns < self._places[0].stamp_ns:
            return None
        after = bisect_right(self._places, stamp_ns, key=lambda place: place.stamp_ns)
        before = self._places[after - 1]
        if after < len(self._places):
            return _interpolate(before, self._places[after], stamp_ns)
        if before.stamp_ns == stamp_ns:
            return before
        return _moved(before, stamp_ns, self._driven(stamp_ns)) if predict else None

    def _driven(self, stamp_ns: int) -> FloatArray:
        last = self._places[-1]
        dt = min(seconds_between(last.stamp_ns, stamp_ns), self._timeout)
        x, y, theta = last.pose.tolist()
        return np.array([*arc(x, y, theta, self._twist.linear, self._twist.angular, dt)])

    def _leaps(self, stamp_ns: int, here: FloatArray) -> bool:
        last = self._places[-1]
        dt = seconds_between(last.stamp_ns, stamp_ns)
        x, y, turn = np.abs(relative_pose(last.pose, here)).tolist()
        fast = math.hypot(x, y) > FASTEST * dt or turn > FASTEST_TURN * dt
        return dt <= 0.0 or dt > LONGEST_STEP_S or fast

    def _append(self, stamp_ns: int, here: FloatArray) -> None:
        self._places.append(_moved(self._places[-1], stamp_ns, here))
        oldest = stamp_ns - int(KEPT_S * NANOSECONDS)
        while len(self._places) > 2 and self._places[1].stamp_ns < oldest:
            self._places.pop(0)


def _moved(before: PathPlace, stamp_ns: int, here: FloatArray) -> PathPlace:
    x, y, turn = relative_pose(before.pose, here).tolist()
    way = before.way + math.hypot(x, y)
    return PathPlace(stamp_ns, here, way, before.turn + abs(turn), before.epoch)


def _interpolate(before: PathPlace, after: PathPlace, stamp_ns: int) -> PathPlace:
    part = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    motion = relative_pose(before.pose, after.pose)
    pose = before.pose + part * (after.pose - before.pose)
    pose[2] = before.pose[2] + part * motion[2]
    way = before.way + part * (after.way - before.way)
    turn = before.turn + part * (after.turn - before.turn)
    return PathPlace(stamp_ns, pose, way, turn, before.epoch)
