"""
Odometry: whether it agrees with the images and with the commands.

They measure motion between two images better than commands do; but an encoder may be unplugged,
a driver repeat its last pose, a frame be mirrored. Images tell the turn, and the way as far as a
memory of views has a scale; commands say what a base does at most. Until odometry has agreed
once it is not used, and never again in this run once it has been contradicted several times.
"""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.estimate.base_model import (
    FASTER,
    heading_deviation,
    MOST_CONTRADICTIONS,
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
# by what a view has [rad, m].
TURN_SHARE, WAY_SHARE, TURN_OF_WAY, LEAST_TURN, LEAST_WAY = 0.15, 0.1, 0.12, 0.01, 0.003
BETTER = 0.5  # of its error, that commands must have: else they are wrong as well
JUMP_SPEEDS, JUMP_WAY, JUMP_TURN = 2.0, 0.03, 0.05  # over the largest speeds, and beyond [m, rad]
MOST_DEVIATION = 0.02  # of a heading that tells a turn [rad]
COMMANDED_WAY = 0.4  # commanded, after which it is held against that [m]
LATE, LATER = 0.15, 0.19  # of a way commanded, that a base obeys late [m]
NO_LONGER = 'it is not used any more in this run, which goes on by commands'


@dataclass(frozen=True, slots=True)
class Seen:
    """What an image shows of where the robot is; ``place`` and its deviation by a memory alone."""

    heading: float
    deviation: float
    place: tuple[float, float] | None = None
    place_deviation: float = math.nan


@dataclass(frozen=True, slots=True)
class OdometryCheck:
    """Motion by odometry, and as ``commanded``, since an image that had ``seen`` the robot."""

    seen: Seen
    motion: Motion = Motion()
    commanded: Motion = Motion()

    def after(self, motion: Motion, commanded: Motion) -> 'OdometryCheck':
        """Return the check with one more motion in it."""
        return OdometryCheck(self.seen, _sum(self.motion, motion), _sum(self.commanded, commanded))

    @property
    def is_long(self) -> bool:
        """Whether it is long enough for a verdict."""
        turn = max(abs(self.motion.turn), abs(self.commanded.turn))
        return turn >= SEEN_TURN or max(abs(self.motion.way), abs(self.commanded.way)) >= SEEN_WAY


@dataclass(frozen=True, slots=True)
class Errors:
    """What odometry and commands differ by from what is ``seen``, and what odometry may."""

    seen: float
    odometry: float = 0.0
    commanded: float = 0.0
    bound: float = math.inf

    @property
    def fits(self) -> bool:
        """Whether odometry is right."""
        return self.odometry <= self.bound

    @property
    def contradicts(self) -> bool:
        """Whether it is wrong, and commands know better."""
        return not self.fits and self.commanded < BETTER * self.odometry


def turn_errors(check: OdometryCheck, seen: Seen) -> Errors:
    """Return the errors of turns."""
    before, turn = check.seen, check.motion.turn
    change = math.remainder(seen.heading - before.heading, 2.0 * math.pi)
    bound = TURN_SHARE * max(abs(change), abs(turn)) + TURN_OF_WAY * abs(check.motion.way)
    bound += DEVIATIONS * math.hypot(before.deviation, seen.deviation) + LEAST_TURN
    off, read = (
        abs(math.remainder(each - change, 2.0 * math.pi)) for each in (turn, check.commanded.turn)
    )
    return Errors(change, off, read, bound)


def way_errors(check: OdometryCheck, seen: Seen) -> Errors:
    """Return the errors of ways ahead; none where no memory gives the places."""
    before = check.seen
    if before.place is None or seen.place is None:
        return Errors(math.nan)
    heading = before.heading + 0.5 * check.motion.turn
    right, ahead = seen.place[0] - before.place[0], seen.place[1] - before.place[1]
    way = ahead * math.cos(heading) - right * math.sin(heading)
    bound = WAY_SHARE * max(abs(way), abs(check.motion.way)) + LEAST_WAY
    bound += max(seen.place_deviation, before.place_deviation)
    return Errors(way, abs(check.motion.way - way), abs(check.commanded.way - way), bound)


def _sum(one: Motion, other: Motion) -> Motion:
    return Motion(one.way + other.way, one.turn + other.turn)


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
        if pose is None and self.pose is None and self.check is None:
            return self, by_commands
        if self.refuted:
            return replace(self, pose=pose), by_commands
        if self.pose is None or pose is None or not 0.0 < dt < MOST_GAP_S:
            return replace(self, pose=pose, check=None), by_commands
        motion = Motion(*motion_between(self.pose, pose), measured=True)
        trouble = _jump(motion, dt, settings)
        if trouble:
            return replace(self, pose=pose, check=None)._unseen(trouble), by_commands
        check = None if self.check is None else self.check.after(motion, commanded)
        after = replace(
            self,
            pose=pose,
            check=check,
            driven=self.driven + motion.way,
            commanded=self.commanded + commanded.way,
        )
        return after, OdometryIncrement(commanded, motion, self.trusted)

    def judge(self, measurement: Measurement) -> 'Odometry':
        """Return what is known after it was held against a ``measurement``, and commands."""
        if self.refuted or self.pose is None:
            return self
        seen = Seen(
            measurement.heading_error,
            heading_deviation(measurement),
            measurement.offset,
            measurement.offset_deviation,
        )
        return self._against_commands(seen)._against_images(seen)

    def _against_images(self, seen: Seen) -> 'Odometry':
        if self.refuted or not seen.deviation <= MOST_DEVIATION:
            return self
        begun, check = replace(self, check=OdometryCheck(seen)), self.check
        if check is None or (seen.place is None) != (check.seen.place is None):
            return begun
        turn, way = turn_errors(check, seen), way_errors(check, seen)
        for errors, words in ((turn, _turn_words), (way, _way_words)):
            if errors.contradicts:
                return begun._unseen(words(check, errors))
        if not check.is_long:
            return self
        turned = abs(check.motion.turn) >= 0.5 * SEEN_TURN
        if not (turn.fits and way.fits) or not (turned or seen.place):
            # Nor do commands fit: it is the image, or somebody pushed the robot. Or it drove
            # straight ahead, of which two views do not tell how far.
            return begun
        begun = replace(begun, unseen=max(self.unseen - 1, 0))
        return begun._proven() if turned else begun

    def _against_commands(self, seen: Seen) -> 'Odometry':
        side = math.copysign(1.0, self.commanded)
        driven, commanded = side * self.driven, side * self.commanded
        begun = replace(self, driven=0.0, commanded=0.0)
        too_far = driven > FASTER * commanded + LATE
        if not too_far and commanded < COMMANDED_WAY:
            return self
        if not too_far and driven >= SLOWER * commanded - LATER:
            return replace(begun, untold=max(self.untold - 1, 0))._proven()
        if not too_far and self.check is not None and _stands(self.check, seen):
            return begun
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
        return replace(self, refuted=f'{trouble}; {NO_LONGER}')


def _stands(check: OdometryCheck, seen: Seen) -> bool:
    """Return whether a memory sees no more of a way than odometry says, whatever is commanded."""
    errors = way_errors(check, seen)
    return errors.bound < COMMANDED_WAY and errors.fits  # else it does not know that way either


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


def _turn_words(check: OdometryCheck, errors: Errors) -> str:
    return (
        f'odometry says a turn of {check.motion.turn:.2f} rad where {errors.seen:.2f} rad are '
        'seen; look at the wheel encoders, and whether yaw of odom grows to the left'
    )


def _way_words(check: OdometryCheck, errors: Errors) -> str:
    return (
        f'odometry says {check.motion.way:.3f} m where {errors.seen:.3f} m are seen; look at '
        'the wheel encoders'
    )
