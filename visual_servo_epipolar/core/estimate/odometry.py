"""
Odometry: whether it agrees with the images and with the commands.

They measure motion between two images better than commands do; but an encoder may be unplugged,
a driver repeat its last pose, a frame be mirrored. Images tell the turn, and the way as far as a
memory of views has a scale; commands say what a base does at most. Until odometry has agreed
once it is not used, and never again in this run once it has been contradicted several times.
"""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

from visual_servo_epipolar.core.estimate.base_model import (
    FASTER,
    heading_deviation,
    MOST_CONTRADICTIONS,
    MOST_DEVIATION,
    SLOWER,
)
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import motion_between, Pose
from visual_servo_epipolar.core.odometry.increments import Motion, OdometryIncrement
from visual_servo_epipolar.core.stamps import MOST_GAP_S
from visual_servo_epipolar.core.twoview.measurement import Measurement

SEEN_TURN, SEEN_WAY = 0.12, 0.3  # motion after which it is held against images [rad, m]
DEVIATIONS = 5.0  # of a turn that is seen
# What wheels may differ by from what is seen: of a turn, of a way, by unequal wheels [rad/m], and
# by what a view has [m].
TURN_SHARE, WAY_SHARE, TURN_OF_WAY, LEAST_WAY = 0.15, 0.1, 0.12, 0.003
JUMP_SPEEDS, JUMP_WAY, JUMP_TURN = 2.0, 0.03, 0.05  # over the largest speeds, and beyond [m, rad]
COMMANDED_WAY = 0.4  # commanded, after which it is held against that [m]
LATE = 0.17  # of a way commanded, that a base obeys late [m]


class MotionComparison(NamedTuple):
    """A quantity as images show it, the errors of odometry and commands, and a bound of these."""

    seen: float
    error: float = 0.0
    commanded_error: float = 0.0
    bound: float = math.inf

    @property
    def fits(self) -> bool:
        """Whether odometry is right."""
        return self.error <= self.bound

    @property
    def contradicts(self) -> bool:
        """Whether it is wrong, and commands are right, or much less wrong."""
        return not self.fits and self.commanded_error < 0.5 * self.error


@dataclass(frozen=True, slots=True)
class OdometryCheck:
    """Motion by odometry, and as ``commanded``, since an image that had ``seen`` the robot."""

    seen: Measurement
    motion: Motion = Motion()
    commanded: Motion = Motion()

    def after(self, motion: Motion, commanded: Motion) -> 'OdometryCheck':
        """Return the check with one more motion in it."""
        return OdometryCheck(self.seen, self.motion + motion, self.commanded + commanded)

    @property
    def is_long(self) -> bool:
        """Whether it is long enough for a verdict."""
        turn = max(abs(self.motion.turn), abs(self.commanded.turn))
        return turn >= SEEN_TURN or max(abs(self.motion.way), abs(self.commanded.way)) >= SEEN_WAY

    def turn(self, now: Measurement) -> MotionComparison:
        """Compare turns."""
        seen = math.remainder(now.heading_error - self.seen.heading_error, 2.0 * math.pi)
        error, commanded = (
            abs(math.remainder(each.turn - seen, 2.0 * math.pi))
            for each in (self.motion, self.commanded)
        )
        bound = TURN_SHARE * max(abs(seen), abs(self.motion.turn)) + MOST_DEVIATION
        bound += TURN_OF_WAY * abs(self.motion.way)
        bound += DEVIATIONS * math.hypot(*map(heading_deviation, (self.seen, now)))
        return MotionComparison(seen, error, commanded, bound)

    def way(self, now: Measurement) -> MotionComparison:
        """Compare ways ahead, which fit where no memory of views gives both places."""
        if self.seen.offset is None or now.offset is None:
            return MotionComparison(math.nan)
        heading = self.seen.heading_error + 0.5 * self.motion.turn
        (right, ahead), (x, y) = now.offset, self.seen.offset
        seen = (ahead - y) * math.cos(heading) - (right - x) * math.sin(heading)
        bound = WAY_SHARE * max(abs(seen), abs(self.motion.way)) + LEAST_WAY
        bound += max(now.offset_deviation, self.seen.offset_deviation)
        error, commanded = (abs(each.way - seen) for each in (self.motion, self.commanded))
        return MotionComparison(seen, error, commanded, bound)

    def contradiction(self, turn: MotionComparison, way: MotionComparison) -> str:
        """Return in words what images contradict; or ''."""
        if turn.contradicts:
            return (
                f'odometry says a turn of {self.motion.turn:.2f} rad where {turn.seen:.2f} rad '
                'are seen; look at the wheel encoders, and whether yaw of odom grows to the left'
            )
        if way.contradicts:
            return (
                f'odometry says {self.motion.way:.3f} m where {way.seen:.3f} m are seen; look at '
                'the wheel encoders'
            )
        return ''

    def stands(self, now: Measurement) -> bool:
        """Return whether a memory sees no more of a way than odometry says."""
        way = self.way(now)
        return way.bound < COMMANDED_WAY and way.fits  # else it does not know that way either


@dataclass(frozen=True, slots=True)
class Odometry:
    """
    Odometry: its ``pose`` at the last image, None where there was none, and what it is worth.

    ``check`` holds it against images, ``driven`` and ``commanded`` [m] are the way by odometry and
    by commands. ``proven`` says whether it has agreed, ``unseen`` and ``untold`` count how often
    it did not with images and with commands, less how often it did: a memory whose scale is that
    of odometry forgives no way that was not commanded. ``refuted`` says why it is not used any
    more.
    """

    pose: Pose | None = None
    check: OdometryCheck | None = None
    driven: float = 0.0
    commanded: float = 0.0
    proven: bool = False
    unseen: int = 0
    untold: int = 0
    refuted: str = ''

    @property
    def trusted(self) -> bool:
        """Whether it counts."""
        return self.proven and not self.refuted

    def after(
        self, pose: Pose | None, commanded: Motion, dt: float, settings: DriveSettings
    ) -> tuple['Odometry', OdometryIncrement]:
        """
        Return what is known with the ``pose`` at an image ``dt`` [s] later, and what was driven.

        A pose that no base comes to in this time is a jump: the motion is then that ``commanded``.
        """
        by_commands = OdometryIncrement(commanded, commanded, self.trusted)
        if self.refuted:
            return replace(self, pose=pose), by_commands
        if self.pose is None or pose is None or not 0.0 < dt < MOST_GAP_S:
            return replace(self, pose=pose, check=None), by_commands
        motion = Motion(*motion_between(self.pose, pose), measured=True)
        trouble = _jump(motion, dt, settings)
        if trouble:
            return replace(self, pose=pose, check=None)._unseen(trouble), by_commands
        after = replace(
            self,
            pose=pose,
            check=self.check and self.check.after(motion, commanded),
            driven=self.driven + motion.way,
            commanded=self.commanded + commanded.way,
        )
        return after, OdometryIncrement(commanded, motion, self.trusted)

    def judge(self, now: Measurement) -> 'Odometry':
        """Return what is known after it was held against commands, and a measurement."""
        if self.refuted or self.pose is None:
            return self
        after = self._against_commands(now)
        known = not after.refuted and heading_deviation(now) <= MOST_DEVIATION
        return after._against_images(now) if known else after

    def _against_images(self, now: Measurement) -> 'Odometry':
        begun, check = replace(self, check=OdometryCheck(now)), self.check
        if check is None or (now.offset is None) != (check.seen.offset is None):
            return begun
        turn, way = check.turn(now), check.way(now)
        trouble = check.contradiction(turn, way)
        if trouble:
            return begun._unseen(trouble)
        if not check.is_long:
            return self
        turned = abs(check.motion.turn) >= 0.5 * SEEN_TURN
        if not (turn.fits and way.fits) or not (turned or now.offset):
            # Nor do commands fit: it is the image, or somebody pushed the robot. Or it drove
            # straight ahead, of which two views do not tell how far.
            return begun
        begun = replace(begun, unseen=max(self.unseen - 1, 0))
        return begun._proven() if turned else begun

    def _against_commands(self, now: Measurement) -> 'Odometry':
        side = math.copysign(1.0, self.commanded)
        driven, commanded = side * self.driven, side * self.commanded
        begun = replace(self, driven=0.0, commanded=0.0)
        too_far = driven > FASTER * commanded + LATE
        if not too_far and commanded < COMMANDED_WAY:
            return self
        if not too_far and driven >= SLOWER * commanded - LATE:
            return replace(begun, untold=max(self.untold - 1, 0))._proven()
        if not too_far and self.check is not None and self.check.stands(now):
            return begun  # whatever is commanded
        return replace(begun, untold=self.untold + 1)._refuted(
            self.untold + 1,
            f'odometry says {self.driven:.2f} m where {self.commanded:.2f} m were commanded; look '
            'at the wheel encoders and at the scale of odom',
        )

    def _proven(self) -> 'Odometry':
        """Return what is known after it agreed where a lie would not."""
        if self.proven or self.unseen or self.untold:
            return self
        return replace(self, proven=True, check=None)  # the memory will be of another scale

    def _unseen(self, trouble: str) -> 'Odometry':
        return replace(self, unseen=self.unseen + 1)._refuted(self.unseen + 1, trouble)

    def _refuted(self, contradictions: int, trouble: str) -> 'Odometry':
        if contradictions < MOST_CONTRADICTIONS:
            return self
        refuted = f'{trouble}; it is not used any more in this run, which goes on by commands'
        return replace(self, refuted=refuted)


def _jump(motion: Motion, dt: float, settings: DriveSettings) -> str:
    """Return that no base moves so far in ``dt`` [s]; or ''."""
    most_way = JUMP_SPEEDS * settings.max_linear * dt + JUMP_WAY
    most_turn = JUMP_SPEEDS * settings.max_angular * dt + JUMP_TURN
    if abs(motion.way) <= most_way and abs(motion.turn) <= most_turn:
        return ''
    return (
        f'odometry leaps by {motion.way:.2f} m and {motion.turn:.2f} rad in {dt:.2f} s, at most '
        f'{most_way:.2f} m and {most_turn:.2f} rad can be; what else publishes or resets odom?'
    )
