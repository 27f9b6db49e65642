"""Shutter: when each row of an image is exposed; when it is stamped."""

from collections import deque
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import integrate, motion_between, Pose, Twist
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.simulation.nod import LEVEL, Nod

ENTRIES = 256  # of the history of a base: more than the longest delay takes


class Shutter(NamedTuple):
    """
    Row v of H is exposed for ``exposure`` [s], around v / H * ``readout`` [s] after the first one.

    The photograph is taken at rest.
    """

    readout: float = 0.0
    exposure: float = 0.0

    @property
    def is_instant(self) -> bool:
        """Whether a camera in motion sees what one at rest does."""
        return self.readout == self.exposure == 0.0


INSTANT = Shutter()


class Receipt(NamedTuple):
    """
    Images are received ``delay`` [s] after their exposure, with ``jitter``, and stamped then.

    Without both they have the stamp of their exposure. None comes before its ``readout`` [s] ends.
    """

    delay: float = 0.0
    jitter: float = 0.0
    seed: int = 0
    readout: float = 0.0

    @property
    def stamps(self) -> bool:
        """Whether images are stamped when they are received."""
        return self.delay > 0.0 or self.jitter > 0.0

    def delay_ns(self, frame: int) -> int:
        """Return how late ``frame``, 0, 1, ..., is received [ns]."""
        chance = 0.0
        if self.jitter > 0.0:
            chance = float(np.random.default_rng((self.seed, 8, frame)).standard_normal())
        return round(max(self.delay + self.jitter * chance, self.readout) * NANOSECONDS)


class BodyState(NamedTuple):
    """Where a base is, its velocity, and how its body nods."""

    pose: Pose
    twist: Twist
    nod: Nod = LEVEL


class PoseHistory:
    """What a base did of late; between two entries it drove an arc."""

    def __init__(self) -> None:
        self._entries: deque[tuple[int, BodyState]] = deque(maxlen=ENTRIES)

    def add(self, stamp_ns: int, state: BodyState) -> None:
        """Take in the true ``state`` at ``stamp_ns``; time that runs backwards begins anew."""
        if self._entries and self._entries[-1][0] >= stamp_ns:
            self._entries.clear()
        self._entries.append((stamp_ns, state))

    def during(self, stamp_ns: int, seconds: float) -> BodyState:
        """Return the state at ``stamp_ns``, and its mean velocity for ``seconds`` from there."""
        state = self.at(stamp_ns)
        if seconds == 0.0:
            return state
        after = self.at(stamp_ns + round(seconds * NANOSECONDS))
        way, turn = motion_between(state.pose, after.pose)
        return state._replace(twist=Twist(way / seconds, turn / seconds))

    def at(self, stamp_ns: int) -> BodyState:
        """Return the state at ``stamp_ns``, that of the nearest entry where there is none."""
        after_ns, after = self._entries[-1]
        for before_ns, before in reversed(self._entries):
            if before_ns <= stamp_ns < after_ns:
                gap = seconds_between(before_ns, after_ns)
                way, turn = motion_between(before.pose, after.pose)
                arc, since = Twist(way / gap, turn / gap), seconds_between(before_ns, stamp_ns)
                nod = before.nod.towards(after.nod, since / gap, gap)
                return BodyState(integrate(before.pose, arc, since), arc, nod)
            after_ns, after = before_ns, before
            if after_ns <= stamp_ns:
                break
        return after


def interpolated(nodes: FloatArray, share: FloatArray) -> FloatArray:
    """Return the parabola through ``nodes``, (3, ..., D), of 0, 1/2 and 1, at ``share``, (...)."""
    s = share[..., None]
    start, middle, end = nodes
    return np.asarray(
        (2.0 * s - 1.0) * (s - 1.0) * start
        + 4.0 * s * (1.0 - s) * middle
        + s * (2.0 * s - 1.0) * end
    )
