"""Commands sent: those of the last seconds, and their effect on a base with a delay."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.stamps import KEPT_S, NANOSECONDS

WITHDRAWN_S = 0.5  # after which a command is withdrawn at the latest, if no image comes


@dataclass(frozen=True, slots=True)
class CommandsSent:
    """
    Commands of the last KEPT_S: ``stamps`` of their images [ns], ascending, and ``twists``.

    ``withdrawn`` says that the last one was, at an unknown time: by the sender, if no image
    came in time.
    """

    stamps: tuple[int, ...] = ()
    twists: tuple[Twist, ...] = ()
    withdrawn: bool = False

    def after(self, stamp_ns: int, twist: Twist) -> 'CommandsSent':
        """Return the commands after one more, which the image of ``stamp_ns`` led to."""
        if self.stamps and stamp_ns <= self.stamps[-1]:  # the clock leapt: nothing is known
            return CommandsSent((stamp_ns,), (twist,))
        first, oldest = 0, stamp_ns - round(KEPT_S * NANOSECONDS)
        while first < len(self.stamps) and self.stamps[first] < oldest:
            first += 1
        return CommandsSent((*self.stamps[first:], stamp_ns), (*self.twists[first:], twist))

    def resumed(self, stamp_ns: int) -> 'CommandsSent':
        """Return the commands at the next image, with the end of one that was withdrawn."""
        if not self.withdrawn:
            return self
        if not self.stamps or stamp_ns <= self.stamps[-1] + 1:
            return CommandsSent()
        ended = min(stamp_ns - 1, self.stamps[-1] + round(WITHDRAWN_S * NANOSECONDS))
        return replace(self, withdrawn=False).after(ended, STANDSTILL)

    def turns(self, begin_ns: int, end_ns: int, delays: FloatArray) -> FloatArray:
        """Return the turns commanded between two times less each of ``delays`` [s]: (N,) [rad]."""
        return self._driven([twist.angular for twist in self.twists], begin_ns, end_ns, delays)

    def ways(self, begin_ns: int, end_ns: int, delays: FloatArray) -> FloatArray:
        """Return the ways commanded between two times less each of ``delays`` [s]: (N,) [m]."""
        return self._driven([twist.linear for twist in self.twists], begin_ns, end_ns, delays)

    def _driven(
        self, rates: list[float], begin_ns: int, end_ns: int, delays: FloatArray
    ) -> FloatArray:
        if not self.stamps:
            return np.zeros(len(delays))
        times = np.array([*self.stamps, end_ns]) - end_ns
        steps = np.diff(times) * np.array(rates)
        driven = np.concatenate([[0.0], np.cumsum(steps)])
        late = delays * NANOSECONDS
        before = np.interp(begin_ns - end_ns - late, times, driven)
        return np.asarray((np.interp(-late, times, driven) - before) / NANOSECONDS)

    def rest_s(self, now_ns: int, bands: Twist = STANDSTILL) -> float:
        """Return for how long the base stands by its commands, some within dead ``bands`` [s]."""
        began = now_ns
        for stamp, twist in zip(reversed(self.stamps), reversed(self.twists), strict=True):
            rates = (twist.linear, bands.linear), (twist.angular, bands.angular)
            if any(rate and abs(rate) >= band for rate, band in rates):
                break
            began = stamp
        return (now_ns - began) / NANOSECONDS

    def swing_s(
        self, least: float, *, begin_ns: int, pause: float = math.inf, reversals: int = 2
    ) -> float:
        """
        Return the time between the last two reversals of speeds above ``least`` [s].

        It is 0 where there are fewer than so many ``reversals`` since ``begin_ns``, and since the
        last ``pause`` [s] in which no such speed was sent.
        """
        turned: list[int] = []
        later: tuple[int, float] | None = None
        for stamp, twist in zip(reversed(self.stamps), reversed(self.twists), strict=True):
            if stamp < begin_ns:
                break
            if abs(twist.linear) <= least:
                continue
            if later is not None and later[0] - stamp > pause * NANOSECONDS:
                break
            if later is not None and later[1] * twist.linear < 0.0:
                turned.append(later[0])
            later = stamp, twist.linear
        return (turned[0] - turned[1]) / NANOSECONDS if len(turned) >= reversals else 0.0

    def acting(self, begin_ns: int, end_ns: int, delay: float) -> list[tuple[float, Twist]]:
        """Return spans [s] of what a base does in a time that obeys late by ``delay`` [s]."""
        late_ns = round(delay * NANOSECONDS)
        begin_ns, end_ns = begin_ns - late_ns, end_ns - late_ns
        spans: list[tuple[float, Twist]] = []
        until = end_ns
        for stamp, twist in zip(reversed(self.stamps), reversed(self.twists), strict=True):
            since = max(stamp, begin_ns)
            if since < until:
                spans.append(((until - since) / NANOSECONDS, twist))
                until = since
            if stamp <= begin_ns:
                break
        if until > begin_ns:
            spans.append(((until - begin_ns) / NANOSECONDS, STANDSTILL))
        return spans[::-1]

    def mean(self, begin_ns: int, end_ns: int, delay: float) -> Twist:
        """Return the mean of what a base does between two times that obeys late [m/s, rad/s]."""
        spans = self.acting(begin_ns, end_ns, delay)
        lasted = math.fsum(span for span, _ in spans)
        if not lasted > 0.0:
            return STANDSTILL
        return Twist(
            math.fsum(span * twist.linear for span, twist in spans) / lasted,
            math.fsum(span * twist.angular for span, twist in spans) / lasted,
        )
