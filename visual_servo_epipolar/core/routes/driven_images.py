"""Driven images: those along a way, each with where the base was; bags and nodes teach by them."""

from collections import deque
from collections.abc import Iterator
import math

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import motion_between, Pose
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.routes.teaching import LEAST_STEP, LEAST_TURN
from visual_servo_epipolar.core.servo.admission import (
    Arrival,
    disorder,
    FrozenImageCheck,
    Repetition,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import (
    MOST_GAP_S,
    NOT_ADVANCING,
    OTHER_CLOCK_S,
    seconds_between,
)

MOST_WAITING = 60  # images that are kept until odometry comes: seconds of them
MOST_BACKWARD = 0.05  # that a base may roll back where it stops [m]


class DrivenImages:
    """
    Images along a way in order of time, placed on the ``path`` of the base.

    ``trouble`` says why no route can be learnt from them, and where. Images that are the very same
    for ``still_timeout`` [s] of driving are of a camera that hangs.
    """

    def __init__(self, path: Path, still_timeout: float = ServoSettings.stale_timeout) -> None:
        self.trouble, self._path, self._still_timeout = '', path, still_timeout
        self._repetition, self._views = Repetition(), FrozenImageCheck()
        self._waiting: deque[tuple[Image, Arrival]] = deque()
        self._stamps: list[int] = []  # of all images in order, and of those on the path
        self._placed: list[int] = []
        self._early = self._unordered = self._repeated = 0
        self._epoch, self._moved_ns, self._anchor = path.epoch, 0, Pose(0.0, 0.0, 0.0)
        self._way = self._furthest = 0.0

    @property
    def unplaced(self) -> int:
        """The number of images that the path does not reach yet."""
        return len(self._stamps) - len(self._placed) - self._early

    @property
    def missing(self) -> str:
        """Return in words why no image has a place yet, or ''."""
        if self._placed or not self._stamps:
            return ''
        return self._path.missing(self._stamps[-1])

    @property
    def notes(self) -> list[str]:
        """What is left out of the way."""
        late = seconds_between(self._stamps[0], self._placed[0]) if self._placed else 0.0
        early = self._early if late > MOST_GAP_S else 0
        left_out = {
            f'before {self._path.topic} begins, {late:.1f} s after the first': early,
            'not newer than the one before': self._unordered,
            'the same as the one before while the robot drove': self._repeated,
        }
        return [f'{count} images are left out, {why}' for why, count in left_out.items() if count]

    def see(self, image: Image, stamp_ns: int) -> None:
        """Take in an image, uint8 of shape (H, W)."""
        newest_ns = self._stamps[-1] if self._stamps else None
        disordered = disorder(newest_ns, stamp_ns, 'another recording')
        if disordered:
            self._unordered += 1
            if disordered != NOT_ADVANCING:
                self.trouble = self.trouble or disordered
            return
        if not self._stamps:
            self._epoch = self._path.epoch
        self._stamps.append(stamp_ns)
        repeats = self._repetition.see(image)
        oldest_ns = self._waiting[0][1].stamp_ns if self._waiting else stamp_ns
        full = len(self._waiting) >= MOST_WAITING
        if not full or seconds_between(oldest_ns, stamp_ns) <= MOST_GAP_S:
            back = self._repetition.back
            self._waiting.append((image, Arrival(stamp_ns, stamp_ns, repeats=repeats, back=back)))

    def placed(self) -> Iterator[tuple[Image, int, Pose]]:
        """Yield images that the path reaches by now, their stamps, and where the base was."""
        while self._waiting and not self.trouble:
            image, arrival = self._waiting[0]
            stamp_ns = arrival.stamp_ns
            place, lag = self._path.at(stamp_ns), self._path.lag(stamp_ns)
            never = lag < 0.0 if self._placed else OTHER_CLOCK_S <= abs(lag) < math.inf
            if self._path.epoch != self._epoch:
                self._refuse(self._path.rupture)
            elif never:
                self._refuse(self._path.missing(stamp_ns))
            elif place is None and lag > 0.0:
                return
            else:
                self._waiting.popleft()
                self._early += place is None
                pose = None if place is None else Pose(*place.pose.tolist())
                if pose is not None and self._admits(arrival, pose):
                    yield image, stamp_ns, pose

    def finish(self) -> None:
        """Look for trouble with the whole: where the path ends too early, and with the order."""
        if self.trouble or not self._stamps:
            return
        newest_ns, placed, unplaced = self._stamps[-1], len(self._placed), self.unplaced
        if self.missing:
            self._refuse(self.missing)
        elif unplaced and seconds_between(self._placed[-1], newest_ns) > MOST_GAP_S:
            self._refuse(
                f'{self._path.missing(newest_ns)}; the last {unplaced} of {len(self._stamps)} '
                'images have no place'
            )
        elif self._unordered > placed:
            self._refuse(
                f'{self._unordered} images are not newer than the one before, {placed} are; let '
                'their driver stamp each'
            )
        elif self._furthest < LEAST_STEP:
            self._refuse(f'the robot did not drive, by {self._path.topic}; look at its wheels')

    def _admits(self, arrival: Arrival, pose: Pose) -> bool:
        """Return whether an image at a ``pose`` may be learnt from."""
        way, turn = motion_between(self._anchor, pose)
        if not self._placed or abs(way) > LEAST_STEP or abs(turn) > LEAST_TURN:
            self._anchor, self._moved_ns = pose, arrival.stamp_ns
            self._way += way if self._placed else 0.0
            self._furthest = max(self._furthest, self._way)
        self._placed.append(arrival.stamp_ns)
        drives = seconds_between(self._moved_ns, arrival.stamp_ns) < self._still_timeout
        self._views = self._views.after(arrival, drives=drives)
        still, backward = self._views.trouble(self._still_timeout), self._furthest - self._way
        if still:
            self._refuse(still)
        elif backward > MOST_BACKWARD:
            self._refuse(
                f'the robot drove backward by {backward:.2f} m, at most {MOST_BACKWARD:g} m can '
                'be; teach the way forward, and repeat it with reverse'
            )
        repeated = drives and arrival.repeats > 0
        self._repeated += repeated
        return not (self.trouble or repeated)

    def _refuse(self, reason: str) -> None:
        """Take note of trouble, and where it is."""
        where = ''
        if self._placed:
            since = seconds_between(self._stamps[0], self._placed[-1])
            where = f'after {self._furthest:.2f} m, {since:.1f} s from the first image: '
        self.trouble = f'{where}{reason}; record the way anew'
