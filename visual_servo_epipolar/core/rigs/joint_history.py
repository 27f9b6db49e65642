"""Joint history: the angles of a head at the time of an image, or why they are missing."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
import math

from visual_servo_epipolar.core.arrays import ROUNDING
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.stamps import AHEAD_S, KEPT_S, seconds_between

LONGEST_GAP_S = 0.25  # between two readings, over which angles are interpolated
BEHIND_S = 0.5  # by which it may be older: later it is of no use, or the clocks are apart
FASTER = 2.0  # than the head can turn: what is faster is a leap, or another head
SLACK = 0.03  # of a reading [rad]
BEYOND = 0.2  # the range of a joint, by a worn stop or the zero of an encoder [rad]
TILT_RANGE = -math.pi / 2.0, math.pi / 2.0  # farther the camera is upside down


class JointHistory:
    """
    Angles of the joint ``name`` by stamp, in order of time; stamps that go back begin it anew.

    It turns at ``speed`` [rad/s] within ``limits`` [rad]. After a leap nothing is known any more:
    the encoder differs from its value at the photograph, and no view tells a head that
    slipped from a robot that faces elsewhere.
    """

    def __init__(self, name: str, speed: float, limits: tuple[float, float]) -> None:
        self.name, self._speed, self._limits = name, speed, limits
        self._leapt = self._unusable = ''
        self._stamps: list[int] = []
        self._angles: list[float] = []

    @property
    def is_missing(self) -> bool:
        """Whether no reading has come."""
        return not (self._stamps or self._unusable)

    def add(self, stamp_ns: int, angle: float) -> str:
        """Take in a reading; return what is odd about it, or ''."""
        if self._stamps and stamp_ns == self._stamps[-1]:
            return ''
        trouble, self._unusable = self._oddity(stamp_ns, angle), self._refusal(angle)
        if trouble:
            self._stamps, self._angles = [], []
        if self._unusable:
            return trouble or self._unusable
        self._stamps.append(stamp_ns)
        self._angles.append(angle)
        while seconds_between(self._stamps[0], stamp_ns) > KEPT_S:
            del self._stamps[0], self._angles[0]
        return trouble

    def _refusal(self, angle: float) -> str:
        low, high = self._limits
        if not math.isfinite(angle):
            return f'the angle of {self.name} must be finite, got {angle}; look at its driver'
        if low - BEYOND <= angle <= high + BEYOND:
            return ''
        otherwise = (
            '' if self._limits == TILT_RANGE else ', or set pan_min and pan_max to its range'
        )
        return (
            f'the angle of {self.name} must lie within {low:.4g} to {high:.4g} rad, got '
            f'{angle:g}: degrees, or ticks? Let its driver publish radians{otherwise}'
        )

    def _oddity(self, stamp_ns: int, angle: float) -> str:
        if not (self._stamps and math.isfinite(angle)):
            return ''
        dt = seconds_between(self._stamps[-1], stamp_ns)
        if dt <= 0.0:
            return f'the stamps of {self.name} went back by {-dt:.2f} s; look at the clock'
        turn = abs(angle - self._angles[-1])
        if turn <= FASTER * self._speed * dt + SLACK:
            return ''
        self._leapt = (
            f'angles of {self.name} leap by {turn:.2f} rad in {dt:.3f} s; what else publishes '
            'them, or sets the encoder to zero? Set it as it was at the photograph, and call '
            '~/reset'
        )
        return self._leapt

    def at(self, stamp_ns: int) -> float:
        """Return the angle at the time of an image that has no ``trouble``."""
        after = bisect_left(self._stamps, stamp_ns)
        if after < len(self._stamps) and self._stamps[after] == stamp_ns:
            return self._angles[after]
        after = min(after, len(self._stamps) - 1)
        if after == 0:
            return self._angles[0]
        span_ns = self._stamps[after] - self._stamps[after - 1]
        share = (stamp_ns - self._stamps[after - 1]) / span_ns
        before, then = self._angles[after - 1], self._angles[after]
        return before + share * (then - before)

    def trouble(self, stamp_ns: int | None = None) -> str:
        """Return why the angle at the time of an image, or of the last reading, is not known."""
        if self._leapt or self._unusable:
            return self._leapt or self._unusable
        if not self._stamps:
            return f'no angle of {self.name} yet'
        if stamp_ns is None:
            return ''
        fault = self._untimely(stamp_ns)
        return f'angles of {self.name} {fault}, and at the clocks of head and camera' * bool(fault)

    def _untimely(self, stamp_ns: int) -> str:
        """Return how readings miss the time of an image, and what to look at."""
        late = seconds_between(self._stamps[-1], stamp_ns)
        if late > AHEAD_S:
            limit = f'{AHEAD_S:g} s can be; look at the rate of the head'
            return f'are {late:.2f} s older than the image, at most {limit}'
        if late < -BEHIND_S:
            limit = f'{BEHIND_S:g} s can be; look at how late images come'
            return f'are {-late:.2f} s newer than the image, at most {limit}'
        if stamp_ns < self._stamps[0]:
            early = seconds_between(stamp_ns, self._stamps[0])
            return f'begin {early:.2f} s after the image; look at when the head starts'
        after = min(bisect_left(self._stamps, stamp_ns), len(self._stamps) - 1)
        gap = ROUNDING * (self._stamps[after] - self._stamps[max(after - 1, 0)])
        if gap <= LONGEST_GAP_S or self._stamps[after] == stamp_ns:
            return ''
        limit = f'{LONGEST_GAP_S:g} s can be; look at the rate of the head'
        return f'were silent for {gap:.2f} s around the image, at most {limit}'


class HeadHistory:
    """
    Angles of the joints of a head, however many messages bring them: ``names`` of pan and tilt.

    Pan stays within ``limits`` [rad]. A head whose tilt has no name has none, at zero.
    """

    def __init__(self, names: Sequence[str], speed: float, limits: tuple[float, float]) -> None:
        ranges = zip(names, (limits, TILT_RANGE), strict=True)
        self._joints = [JointHistory(name, speed, each) for name, each in ranges if name]

    @property
    def missing(self) -> list[str]:
        """Names of joints of which no reading has come."""
        return [joint.name for joint in self._joints if joint.is_missing]

    def add(self, stamp_ns: int, angles: Mapping[str, float]) -> str:
        """Take in the ``angles`` of some joints by name; return what is odd about them, or ''."""
        known = [joint for joint in self._joints if joint.name in angles]
        return '; '.join(filter(None, [it.add(stamp_ns, angles[it.name]) for it in known]))

    def at(self, stamp_ns: int) -> Joints | None:
        """Return the angles at the time of an image; None where ``trouble`` says why not."""
        if self.trouble(stamp_ns):
            return None
        return Joints(*(joint.at(stamp_ns) for joint in self._joints))

    def trouble(self, stamp_ns: int | None = None) -> str:
        """Return why the angles at the time of an image, or any, are not known; or ''."""
        return next(filter(None, (joint.trouble(stamp_ns) for joint in self._joints)), '')
