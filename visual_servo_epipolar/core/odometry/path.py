"""The driven path: where the base was at the time of an image, by odometry or by commands."""

from bisect import bisect_right
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import (
    arc,
    motion_between,
    Pose,
    relative_pose,
    STANDSTILL,
    Twist,
)
from visual_servo_epipolar.core.stamps import (
    KEPT_S,
    MOST_GAP_S,
    NANOSECONDS,
    OTHER_CLOCK_S,
    seconds_between,
)

FASTEST, FASTEST_TURN = 5.0, 12.0  # [m/s, rad/s] what is faster is a leap
LEAST_SWING, MOST_ACCELERATION = 0.01, 5.0  # [m, m/s^2] of a base; what swings faster is two


@dataclass(frozen=True, slots=True, eq=False)
class PathPlace:
    """Where the base was: ``pose``, (3,), in the frame of the path since ``epoch`` began."""

    stamp_ns: int
    pose: FloatArray
    epoch: int = 0


class Path:
    """
    Places of the base in order of time, from ``add_pose`` (odometry) or ``add_twist`` (commands).

    What comes on ``topic`` may be ``ahead`` [s] older than an image: the base goes on as it did.
    Commands are obeyed for ``command_timeout`` [s]. A new ``epoch`` begins with a stamp that does
    not advance, a gap, a leap or another frame, as ``rupture`` says in words: what was driven
    before says nothing any more.
    """

    def __init__(
        self, topic: str = 'odom', *, ahead: float = 0.0, command_timeout: float = 0.5
    ) -> None:
        self.topic, self.epoch, self.frame, self.rupture = topic, 0, '', ''
        self._ahead, self._timeout = ahead, command_timeout
        self._places: list[PathPlace] = []
        self._twist = STANDSTILL

    def add_pose(self, stamp_ns: int, pose: Pose, frame: str = '') -> str:
        """Take in odometry in a ``frame``; return why a new epoch begins with it, or ''."""
        here = np.array([pose.x, pose.y, pose.theta])
        last = self._places[-1] if self._places else None
        if last is not None and stamp_ns == last.stamp_ns and np.array_equal(here, last.pose):
            return ''  # the same message once more
        rupture = '' if last is None else self._rupture(last, stamp_ns, here, frame)
        self.frame = frame
        if rupture:
            self._begin_anew(rupture)
        if last is None or rupture:
            self._places = [PathPlace(stamp_ns, here, epoch=self.epoch)]
            return rupture
        dt = seconds_between(last.stamp_ns, stamp_ns)
        way, turn = motion_between(Pose(*last.pose.tolist()), pose)
        self._twist = Twist(way / dt, turn / dt)
        self._append(stamp_ns, here)
        return ''

    def add_twist(self, stamp_ns: int, twist: Twist) -> None:
        """Take in a command, obeyed from now on until the next, or until it is too old."""
        if self._places and stamp_ns < self._places[-1].stamp_ns:
            self._begin_anew(f'the stamps on {self.topic} do not advance')
        if not self._places:
            self._places = [PathPlace(stamp_ns, np.zeros(3), epoch=self.epoch)]
        else:
            self._append(stamp_ns, self._driven(stamp_ns))
        self._twist = twist

    def at(self, stamp_ns: int) -> PathPlace | None:
        """Return the place at a stamp, None beyond the path."""
        if not self._places or stamp_ns < self._places[0].stamp_ns:
            return None
        after = bisect_right(self._places, stamp_ns, key=lambda place: place.stamp_ns)
        before = self._places[after - 1]
        if after < len(self._places):
            return _interpolate(before, self._places[after], stamp_ns)
        if before.stamp_ns == stamp_ns:
            return before
        if self.lag(stamp_ns) > self._ahead:
            return None
        return PathPlace(stamp_ns, self._driven(stamp_ns), before.epoch)

    def lag(self, stamp_ns: int) -> float:
        """Return how much later than the path a stamp is [s], below 0 if earlier, inf if empty."""
        if not self._places:
            return math.inf
        late = seconds_between(self._places[-1].stamp_ns, stamp_ns)
        early = seconds_between(self._places[0].stamp_ns, stamp_ns)
        return late if late > 0.0 else min(early, 0.0)

    def missing(self, stamp_ns: int) -> str:
        """Return in words how the path misses an image of this stamp, and what to do."""
        if not self._places:
            return f'nothing usable came on {self.topic} yet; start what publishes it, or remap it'
        lag = self.lag(stamp_ns)
        end_s = self._places[-1 if lag > 0.0 else 0].stamp_ns / NANOSECONDS
        advice = 'look at its rate, and at the clocks of base and camera'
        if abs(lag) >= OTHER_CLOCK_S:
            advice = 'let one clock stamp both: set use_sim_time, or the clock of a driver'
        apart = f'{lag:.2f} s older than' if lag > 0.0 else f'{-lag:.2f} s newer than'
        return (
            f'{self.topic} is {apart} the image, stamped {end_s:.2f} s and '
            f'{stamp_ns / NANOSECONDS:.2f} s; {advice}'
        )

    def _driven(self, stamp_ns: int) -> FloatArray:
        last = self._places[-1]
        dt = min(seconds_between(last.stamp_ns, stamp_ns), self._timeout)
        x, y, theta = last.pose.tolist()
        return np.array([*arc(x, y, theta, self._twist.linear, self._twist.angular, dt)])

    def _begin_anew(self, rupture: str) -> None:
        self.epoch, self.rupture = self.epoch + 1, rupture
        self._places, self._twist = [], STANDSTILL

    def _rupture(self, last: PathPlace, stamp_ns: int, here: FloatArray, frame: str) -> str:
        """Return why no base has driven from the ``last`` place to ``here``; or ''."""
        if frame != self.frame:
            return f'{self.topic} is in the frame {frame}, was in {self.frame} before'
        dt = seconds_between(last.stamp_ns, stamp_ns)
        if dt <= 0.0:
            return f'the stamps on {self.topic} do not advance'
        if dt > MOST_GAP_S:
            return f'{self.topic} was silent for {dt:.2f} s, at most {MOST_GAP_S:g} s can be'
        x, y, turn = relative_pose(last.pose, here).tolist()
        step = math.hypot(x, y)
        if step > FASTEST * dt or abs(turn) > FASTEST_TURN * dt:
            return (
                f'{self.topic} leaps by {step:.2f} m and {turn:.2f} rad in {dt:.3f} s, at most '
                f'{FASTEST:g} m/s and {FASTEST_TURN:g} rad/s can be'
            )
        return self._swing(x, y, stamp_ns)

    def _swing(self, x: float, y: float, stamp_ns: int) -> str:
        """Return that no base undoes its last step so fast by one of ``x``, ``y`` [m]; or ''."""
        if len(self._places) < 2:
            return ''
        before, last = self._places[-2:]
        back_x, back_y, _ = relative_pose(last.pose, before.pose).tolist()
        step = math.hypot(back_x, back_y)
        swing = min(step, (x * back_x + y * back_y) / step) if step > 0.0 else 0.0
        span = seconds_between(before.stamp_ns, stamp_ns)
        # Forth by d in T / 2 and back again takes an acceleration of 8 d / T^2.
        if swing <= max(LEAST_SWING, MOST_ACCELERATION * span**2 / 8.0):
            return ''
        return f'{self.topic} goes to and fro by {swing:.2f} m in {span:.3f} s, as by two sources'

    def _append(self, stamp_ns: int, here: FloatArray) -> None:
        self._places.append(PathPlace(stamp_ns, here, self._places[-1].epoch))
        oldest = stamp_ns - int(KEPT_S * NANOSECONDS)
        while len(self._places) > 2 and self._places[1].stamp_ns < oldest:
            self._places.pop(0)


def _interpolate(before: PathPlace, after: PathPlace, stamp_ns: int) -> PathPlace:
    part = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    motion = relative_pose(before.pose, after.pose)
    pose = before.pose + part * (after.pose - before.pose)
    pose[2] = before.pose[2] + part * motion[2]
    return PathPlace(stamp_ns, pose, before.epoch)
