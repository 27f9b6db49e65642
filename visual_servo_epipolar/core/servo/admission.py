"""Admission: which images are new, by their stamps and by their features."""

from collections import deque
from dataclasses import dataclass, replace
import zlib

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.stamps import (
    MOST_GAP_S,
    NOT_ADVANCING,
    OTHER_CLOCK_S,
    seconds_between,
)

STILL_S = 0.25  # that a simulated clock stands still, and images come: a step of it is shorter
DISTRUST_S = 2.0  # after an image of another time: where one comes, others do that are not known
KEPT = 64  # images that are known again: six seconds of them
ROWS = 8  # of so many one is looked at, which costs 0.1 ms where there are 1280x1024 px


@dataclass(frozen=True, slots=True)
class Arrival:
    """
    Arrival of an image, stamped ``stamp_ns``, at ``now_ns`` by the clock of the servo.

    ``still_s`` is for how long a simulated clock has stood there [s]. The image was the very same
    ``repeats`` times in a row, or came last ``back`` images ago; 0 if it is new.
    """

    stamp_ns: int
    now_ns: int
    still_s: float = 0.0
    repeats: int = 0
    back: int = 0


def refusal(arrival: Arrival, max_latency: float) -> str:
    """Return why an image more than ``max_latency`` [s] from now is not driven by; or ''."""
    stamp_ns, now_ns = arrival.stamp_ns, arrival.now_ns
    age = seconds_between(stamp_ns, now_ns)
    if max_latency == 0.0 or abs(age) <= max_latency:
        return ''
    if stamp_ns == 0:
        return 'the images are stamped 0, so their age is unknown; let their driver stamp them'
    if now_ns == 0:
        return 'use_sim_time is true, but the clock stands at 0; is /clock published?'
    if arrival.still_s > STILL_S:
        return (
            f'/clock has stood still at {seconds_between(0, now_ns):.2f} s for '
            f'{arrival.still_s:.1f} s while images come; is the simulation paused, or has its '
            'publisher ended?'
        )
    if -OTHER_CLOCK_S < age < 0.0 or abs(age) >= OTHER_CLOCK_S:
        side = 'behind' if age > 0.0 else 'ahead of'
        return (
            f'the images are stamped {abs(age):.2f} s {side} the clock of the servo; set the '
            'clock of their driver, or use_sim_time where they come from a bag or a simulator'
        )
    return (
        f'the images are {age:.2f} s old when their tracks come, max_latency is {max_latency:g} '
        's; send smaller images or fewer, or synchronise the clocks'
    )


def disorder(newest_ns: int | None, stamp_ns: int, remedy: str) -> str:
    """Return that a stamp is not newer than the newest of the run, ``newest_ns``; or ''."""
    if newest_ns is None or stamp_ns > newest_ns:
        return ''
    back_s = seconds_between(stamp_ns, newest_ns)
    if back_s <= MOST_GAP_S:  # one image overtook another on a network
        return NOT_ADVANCING
    return (
        f'the stamps went back by {back_s:.1f} s: a bag played in a loop, or a clock that was '
        f'set; {remedy} begins anew'
    )


@dataclass(frozen=True, slots=True)
class FrozenImageCheck:
    """
    For how long images have been the very same while the robot was to drive, ``still_s``.

    A driver that stamps its last image anew for ever looks alive by its stamps. A robot that
    stands proves nothing: without noise, its view does not change. An image that came before the
    last one, and comes again with a new stamp, is of another time: no robot drives back to it to
    the last bit. A simulator whose noise repeats may show it to one that stands, or has just
    started: it must have had to drive before the last image, too (``drives``). ``old_ns`` is the
    stamp of the last image of another time.
    """

    stamp_ns: int = 0
    still_s: float = 0.0
    drives: bool = False
    old_ns: int | None = None

    def after(self, arrival: Arrival, *, drives: bool) -> 'FrozenImageCheck':
        """Return the check after an image, of a robot that had to drive since the last."""
        still_s = self.still_s if arrival.repeats else 0.0
        if arrival.repeats and drives:
            still_s += seconds_between(self.stamp_ns, arrival.stamp_ns)
        after = FrozenImageCheck(arrival.stamp_ns, still_s, drives, self.old_ns)
        if arrival.back > 1 and (self.drives and drives or after.distrusts):
            return replace(after, old_ns=arrival.stamp_ns)
        return after

    @property
    def distrusts(self) -> bool:
        """Whether an image of another time came a while ago."""
        if self.old_ns is None:
            return False
        return abs(seconds_between(self.old_ns, self.stamp_ns)) <= DISTRUST_S

    def admit(
        self,
        arrival: Arrival,
        newest_ns: int | None,
        *,
        drives: bool,
        max_latency: float,
        still_timeout: float,
        withheld: str = '',
        remedy: str = '~/stop, then ~/start',
    ) -> tuple['FrozenImageCheck', str]:
        """
        Return the check after an image came, and why no step is taken by it, or ''.

        It is too old, not newer than ``newest_ns`` of the run, the very same for ``still_timeout``
        [s] of driving, or the run is ``withheld``; the ``remedy`` is what begins anew.
        """
        trouble = refusal(arrival, max_latency) or disorder(newest_ns, arrival.stamp_ns, remedy)
        if trouble or withheld:
            return self, trouble or withheld
        after = self.after(arrival, drives=drives)
        return after, '' if newest_ns is None else after.trouble(still_timeout)

    def trouble(self, timeout: float) -> str:
        """Return why views prove nothing: the same for ``timeout`` [s], or old ones; or ''."""
        if self.still_s > timeout:
            return (
                f'the images have shown the very same for {self.still_s:.1f} s of driving: the '
                'camera hangs, or the wheels do not turn; restart its driver'
            )
        if self.distrusts:
            return (
                'images of another time of the run come with new stamps: a buffer is played '
                'again, a driver mixes its images up, or the wheels do not turn; restart it'
            )
        return ''


class Repetition:
    """How often the newest image came in a row, and how many images ago (``back``), 0 if new."""

    def __init__(self) -> None:
        self._last: Image | None = None
        self._kept: deque[object] = deque(maxlen=KEPT)  # the newest first
        self.count, self.back = 0, 0

    def see(self, image: Image | None) -> int:
        """Take the next image, None if it could not be read, and return the count."""
        known = None
        if image is not None:  # what two that are not the very same hardly ever share
            known = image.shape, zlib.crc32(np.ascontiguousarray(image[::ROWS]).data)
        again = bool(self._kept) and known == self._kept[0] and self._is_last(image)
        self._last, self.count = image, self.count + 1 if again else 0
        self.back = 0
        if known is not None and known in self._kept:
            self.back = self._kept.index(known) + 1
        self._kept.appendleft(known)
        return self.count

    def _is_last(self, image: Image | None) -> bool:
        """Return whether an image is the last one, pixel by pixel."""
        return image is not None and self._last is not None and np.array_equal(image, self._last)
