"""Odometry check: what the wheels and commands say of a drive, held against what is seen."""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.odometry.increments import Motion

SEEN_TURN, SEEN_WAY = 0.12, 0.3  # motion after which it is held against images [rad, m]
DEVIATIONS = 5.0  # of a turn that is seen
# What wheels may differ by from what is seen: of a turn, of a way, by unequal wheels [rad/m], and
# by what a view has [rad, m].
TURN_SHARE, WAY_SHARE, TURN_OF_WAY, LEAST_TURN, LEAST_WAY = 0.15, 0.1, 0.12, 0.01, 0.003
BETTER = 0.5  # of its error, that commands must have: else they are wrong as well


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
    off, told = (
        abs(math.remainder(each - change, 2.0 * math.pi)) for each in (turn, check.commanded.turn)
    )
    return Errors(change, off, told, bound)


def way_errors(check: OdometryCheck, seen: Seen) -> Errors:
    """Return the errors of ways ahead; none where no memory knows the places."""
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
