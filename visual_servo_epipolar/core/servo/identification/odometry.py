"""
Odometry: whether the wheels tell the truth, by what is seen and by what was commanded.

They know way and turn between two images better than commands do; but an encoder may be unplugged,
a driver repeat its last pose, a frame be mirrored. Images tell the turn, and the way as far as a
memory of views knows its scale; commands say what a base does at most. Until odometry has agreed
once it is not used, and no more in this run once it has been contradicted several times.
"""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.geometry.motion import motion_between, Pose
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.identification.curvature import heading_deviation
from visual_servo_epipolar.core.servo.identification.physical import FASTER, SLOWER
from visual_servo_epipolar.core.servo.identification.stretch import (
    Errors,
    Seen,
    SEEN_TURN,
    Stretch,
    turn_errors,
    way_errors,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.steadying import Driven, Motion

MOST_CONTRADICTIONS = 3  # less the times that it agreed since
GAP_S = 1.0  # without images, over which anybody may have moved the robot
LEAP_SPEEDS, LEAP_WAY, LEAP_TURN = 2.0, 0.03, 0.05  # over the largest speeds, and beyond [m, rad]
MOST_DEVIATION = 0.02  # of a heading that tells a turn [rad]
TOLD_WAY = 0.4  # commanded, after which it is held against that [m]
LATE, LATER = 0.15, 0.19  # of a way commanded, that a base obeys late [m]
NO_LONGER = 'it is not used any more in this run, which goes on by commands'


@dataclass(frozen=True, slots=True)
class Odometry:
    """
    Odometry: its ``pose`` at the last image, None where there was none, and what it is worth.

    ``stretch`` is held against images, ``driven`` and ``told`` [m] are the way by odometry and by
    commands. ``proven`` says whether it has agreed, ``unseen`` and ``untold`` count how often it
    did not with images and with commands, less how often it did: a memory whose scale is that of
    odometry forgives no way that was not commanded. ``refuted`` says why it is not used any more.
    """

    pose: Pose | None = None
    stretch: Stretch | None = None
    driven: float = 0.0
    told: float = 0.0
    proven: bool = False
    unseen: int = 0
    untold: int = 0
    refuted: str = ''

    @property
    def trusted(self) -> bool:
        """Whether it counts."""
        return self.proven and not self.refuted

    def checked(
        self, pose: Pose | None, commanded: Motion, dt: float, settings: ServoSettings
    ) -> tuple['Odometry', Driven]:
        """
        Return what is known with the ``pose`` at an image ``dt`` [s] later, and what was driven.

        A pose that no base comes to in this time is a leap: the motion is then that ``commanded``.
        """
        told = Driven(commanded, commanded, self.trusted)
        if pose is None and self.pose is None and self.stretch is None:
            return self, told
        if self.refuted:
            return replace(self, pose=pose), told
        if self.pose is None or pose is None or not 0.0 < dt < GAP_S:
            return replace(self, pose=pose, stretch=None), told
        motion = Motion(*motion_between(self.pose, pose), measured=True)
        trouble = _leap(motion, dt, settings)
        if trouble:
            return replace(self, pose=pose, stretch=None)._unseen(trouble), told
        stretch = None if self.stretch is None else self.stretch.after(motion, commanded)
        after = replace(
            self,
            pose=pose,
            stretch=stretch,
            driven=self.driven + motion.way,
            told=self.told + commanded.way,
        )
        return after, Driven(commanded, motion, self.trusted)

    def judged(self, measurement: Measurement) -> 'Odometry':
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
        begun, stretch = replace(self, stretch=Stretch(seen)), self.stretch
        if stretch is None or (seen.place is None) != (stretch.seen.place is None):
            return begun
        turn, way = turn_errors(stretch, seen), way_errors(stretch, seen)
        for errors, words in ((turn, _turn_words), (way, _way_words)):
            if errors.contradicts:
                return begun._unseen(words(stretch, errors))
        if not stretch.is_long:
            return self
        turned = abs(stretch.motion.turn) >= 0.5 * SEEN_TURN
        if not (turn.fits and way.fits) or not (turned or seen.place):
            # Nor do commands fit: it is the image, or somebody pushed the robot. Or it drove
            # straight ahead, of which two views do not tell how far.
            return begun
        begun = replace(begun, unseen=max(self.unseen - 1, 0))
        return begun._proven() if turned else begun

    def _against_commands(self, seen: Seen) -> 'Odometry':
        side = math.copysign(1.0, self.told)
        driven, told = side * self.driven, side * self.told
        begun = replace(self, driven=0.0, told=0.0)
        too_far = driven > FASTER * told + LATE
        if not too_far and told < TOLD_WAY:
            return self
        if not too_far and driven >= SLOWER * told - LATER:
            return replace(begun, untold=max(self.untold - 1, 0))._proven()
        if not too_far and self.stretch is not None and _stands(self.stretch, seen):
            return begun
        return replace(begun, untold=self.untold + 1)._refuted(
            self.untold + 1,
            f'odometry says {self.driven:.2f} m where {self.told:.2f} m were commanded; look at '
            'the wheel encoders and at the scale of odom',
        )

    def _proven(self) -> 'Odometry':
        """Return what is known after it agreed where a lie would not."""
        if self.proven or self.unseen or self.untold:
            return self
        return replace(self, proven=True, stretch=None)  # the memory will be of another scale

    def _unseen(self, trouble: str) -> 'Odometry':
        return replace(self, unseen=self.unseen + 1)._refuted(self.unseen + 1, trouble)

    def _refuted(self, contradictions: int, trouble: str) -> 'Odometry':
        if contradictions < MOST_CONTRADICTIONS:
            return self
        return replace(self, refuted=f'{trouble}; {NO_LONGER}')


def _stands(stretch: Stretch, seen: Seen) -> bool:
    """Return whether a memory sees no more of a way than odometry says, whatever is commanded."""
    errors = way_errors(stretch, seen)
    return errors.bound < TOLD_WAY and errors.fits  # else it does not know that way either


def _leap(motion: Motion, dt: float, settings: ServoSettings) -> str:
    """Return that no base moves so far in ``dt`` [s]; or ''."""
    most_way = LEAP_SPEEDS * settings.max_linear * dt + LEAP_WAY
    most_turn = LEAP_SPEEDS * settings.max_angular * dt + LEAP_TURN
    if abs(motion.way) <= most_way and abs(motion.turn) <= most_turn:
        return ''
    return (
        f'odometry leaps by {motion.way:.2f} m and {motion.turn:.2f} rad in {dt:.2f} s, at most '
        f'{most_way:.2f} m and {most_turn:.2f} rad can be; look who else publishes or resets odom'
    )


def _turn_words(stretch: Stretch, errors: Errors) -> str:
    return (
        f'odometry says a turn of {stretch.motion.turn:.2f} rad where {errors.seen:.2f} rad are '
        'seen; look at the wheel encoders, and whether yaw of odom grows to the left'
    )


def _way_words(stretch: Stretch, errors: Errors) -> str:
    return (
        f'odometry says {stretch.motion.way:.3f} m where {errors.seen:.3f} m are seen; look at '
        'the wheel encoders'
    )
