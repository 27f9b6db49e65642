"""Joint history: the angles of a head at the time of an image, and why they are not known."""

from bisect import bisect_left
import math

from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between

KEPT_S = 3.0  # no image is older
LONGEST_GAP_S = 0.25  # between two readings, over which angles are interpolated
AHEAD_S = 0.1  # by which an image may be newer than the last reading: joints go on as they did
BEHIND_S = 0.5  # by which it may be older: later it is of no use, or the clocks are apart
FASTER = 2.0  # than the head can turn: what is faster is a leap, or another head
SLACK = 0.03  # of a reading [rad]


class JointHistory:
    """
    Angles of joints by stamp, in order of time; stamps that go back begin it anew.

    Joints turn at ``speed`` [rad/s]. After a leap nothing is known any more: what the encoder says
    is not what it said at the photograph, and no view tells a head that slipped from a robot that
    faces elsewhere.
    """

    def __init__(self, speed: float) -> None:
        self._speed, self._leapt = speed, ''
        self._stamps: list[int] = []
        self._angles: list[Joints] = []

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last reading; None before the first."""
        return self._stamps[-1] if self._stamps else None

    def add(self, stamp_ns: int, joints: Joints) -> str:
        """Take in a reading; return what is odd about it, or ''."""
        if not all(map(math.isfinite, joints)):
            return f'joint angles must be finite, got {joints.pan} and {joints.tilt}'
        if self._stamps and stamp_ns == self._stamps[-1]:
            return ''
        trouble = self._oddity(stamp_ns, joints)
        if trouble:
            self._stamps, self._angles = [], []
        self._stamps.append(stamp_ns)
        self._angles.append(joints)
        while seconds_between(self._stamps[0], stamp_ns) > KEPT_S:
            del self._stamps[0], self._angles[0]
        return trouble

    def _oddity(self, stamp_ns: int, joints: Joints) -> str:
        if not self._stamps:
            return ''
        dt = seconds_between(self._stamps[-1], stamp_ns)
        if dt <= 0.0:
            return f'the stamps of joint angles went back by {-dt:.2f} s; look at the clock'
        turn = max(abs(now - before) for now, before in zip(joints, self._angles[-1], strict=True))
        if turn <= FASTER * self._speed * dt + SLACK:
            return ''
        self._leapt = (
            f'joint angles leap by {turn:.2f} rad in {dt:.3f} s; look who else publishes them, or '
            'who sets the encoder to zero; set it as it was at the photograph, and call ~/reset'
        )
        return self._leapt

    def at(self, stamp_ns: int) -> Joints | None:
        """Return the angles at the time of an image; None where ``trouble`` says why not."""
        if self.trouble(stamp_ns):
            return None
        after = bisect_left(self._stamps, stamp_ns)
        if after < len(self._stamps) and self._stamps[after] == stamp_ns:
            return self._angles[after]
        after = min(after, len(self._stamps) - 1)
        if after == 0:
            return self._angles[0]
        span_ns = self._stamps[after] - self._stamps[after - 1]
        share = (stamp_ns - self._stamps[after - 1]) / span_ns
        before, then = self._angles[after - 1], self._angles[after]
        return Joints(*(a + share * (b - a) for a, b in zip(before, then, strict=True)))

    def trouble(self, stamp_ns: int) -> str:
        """Return why the angles at the time of an image are not known; or ''."""
        if self._leapt:
            return self._leapt
        if not self._stamps:
            return 'no joint angles yet'
        late = seconds_between(self._stamps[-1], stamp_ns)
        if late > AHEAD_S:
            return (
                f'joint angles are {late:.2f} s older than the image, at most {AHEAD_S:g} s can '
                'be; look at the rate of the head, and at the clocks of head and camera'
            )
        if late < -BEHIND_S:
            return (
                f'joint angles are {-late:.2f} s newer than the image, at most {BEHIND_S:g} s can '
                'be; look at the clocks of head and camera, and at how late images come'
            )
        if stamp_ns < self._stamps[0]:
            early = seconds_between(stamp_ns, self._stamps[0])
            return (
                f'joint angles begin {early:.2f} s after the image; look at the clocks of head '
                'and camera'
            )
        after = min(bisect_left(self._stamps, stamp_ns), len(self._stamps) - 1)
        gap = self._stamps[after] - self._stamps[max(after - 1, 0)]
        if gap > LONGEST_GAP_S * NANOSECONDS and self._stamps[after] != stamp_ns:
            return (
                f'joint angles were silent for {gap / NANOSECONDS:.2f} s around the image, at '
                f'most {LONGEST_GAP_S:g} s can be; let the head publish them more often'
            )
        return ''
