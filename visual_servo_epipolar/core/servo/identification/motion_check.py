"""
Motion check: whether the base moves as it was told, by how the view changes.

The turn and the parallax between two views of the run hold whatever the photograph, the scale of
a memory and the distance are. They are held against what commands make of a base that obeys at
once, or up to MOST_DELAY late. Who stands where a turn or a way was commanded does not follow;
who turns where none was is driven by somebody else, or seen through a wrong or mirrored camera.

A turn is always seen. A way is seen where the photograph shows that there is parallax to be seen:
not in a scene too far away for it, nor near the goal, nor for a command that is a matter of the
dead band.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.servo.commands_sent import CommandsSent
from visual_servo_epipolar.core.servo.identification.physical import (
    FOLLOWED,
    LARGEST_DEAD_BAND,
    MOST_CURVATURE,
    MOST_DELAY_S,
    MOST_TURN_RATIO,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between

DELAYS: FloatArray = np.linspace(0.0, MOST_DELAY_S, 16)  # [s]
COMMON, COMMON_SHARE = 8, 0.4  # features that two views must have in common, of the first one's
LASTING_S = 1.0  # of a reference, if anything moved since
NOISE_OF_PARALLAX = 1.2  # of two views of one place, in deviations of a coordinate
STANDING_TURN, STANDING_PARALLAX = 0.015, 2.5  # of who stands at most [rad], [deviations]
ASKED_TURN, ASKED_PARALLAX = 0.1, 10.0  # that show for certain who stands [rad], [deviations]
# The same of slow commands, of which a dead band may swallow some, and for how long at least [s].
ASKED_SLOWLY, SLOWLY_S = 1.5, 3.0
NUMB_S = 6.0  # of any commands, to who did not follow before and has not moved since [s]
SHARE = 0.25  # of what was commanded, that who stands moves at most
# By which a turn may differ from commands: at least [rad], in deviations of a coordinate, and in
# parallax, which a rotation alone explains wrong.
LEAST_TURN, TURN_DEVIATIONS, TURN_OF_PARALLAX = 0.04, 6.0, 1.5
AGAINST = 0.4, 2.5  # turns seen over turns commanded, of an image that turns against commands
SOON_S, TOLD_TURN = 0.5, 0.01  # in which a base usually follows, and a turn that counts [rad]
MOVED_PARALLAX = 12.0  # of who was moved while it was to stand [deviations]
QUIET_S = 1.0  # after a contradiction, before the run may go on
MOST_CONTRADICTIONS = 3  # in a run


class Reference(NamedTuple):
    """View at ``stamp_ns``: ``ids``, (N,), and unit rays, (N, 3), of its features."""

    stamp_ns: int
    ids: IntArray
    rays: FloatArray


class Seen(NamedTuple):
    """Motion between two views: ``turn``, left positive, ``parallax`` and its ``noise`` [rad]."""

    turn: float
    parallax: float
    noise: float

    @property
    def stands(self) -> bool:
        """Whether nothing moved."""
        within = abs(self.turn) < STANDING_TURN + TURN_DEVIATIONS * self.noise
        return within and self.parallax < STANDING_PARALLAX * self.noise


class Sight(NamedTuple):
    """
    What an image shows to the check.

    ``noise`` is the deviation of a ray [rad], ``parallax_of_way`` what a metre shows at least
    [rad/m], 0 where nobody knows.
    """

    observation: Observation
    noise: float
    parallax_of_way: float


@dataclass(frozen=True, slots=True)
class Asked:
    """Turn [rad] and parallax [rad] commanded while the view stood, since the first of them."""

    since_ns: int | None = None
    turn: float = 0.0
    parallax: float = 0.0

    def after(self, turn: float, parallax: float, begin_ns: int) -> 'Asked':
        """Return what was asked with a command more, which acted from ``begin_ns``."""
        if self.since_ns is None and not turn and not parallax:
            return self
        since_ns = begin_ns if self.since_ns is None else self.since_ns
        return Asked(since_ns, self.turn + turn, self.parallax + parallax)


@dataclass(frozen=True, slots=True, eq=False)
class MotionCheck:
    """
    Check of the motion since a ``reference``, None before the first view.

    ``trouble`` says what contradicts the commands now, '' if nothing does: two views in a row, of
    which the first made it ``suspected``. ``troubled_ns`` is when something did last, None before,
    and ``contradictions`` how often it stopped the run.
    ``asked`` is what was commanded while the view stood, until ``now_ns``; ``numb`` says that it
    stood before where it had to move.
    """

    reference: Reference | None = None
    trouble: str = ''
    suspected: bool = False
    troubled_ns: int | None = None
    contradictions: int = 0
    asked: Asked = Asked()
    now_ns: int = 0
    numb: bool = False

    @property
    def is_final(self) -> bool:
        """Whether it has happened too often for the run to go on."""
        return self.contradictions >= MOST_CONTRADICTIONS

    def disturbed(self, now_ns: int) -> bool:
        """Return whether something contradicts the commands, or did just now."""
        if self.troubled_ns is None:
            return False
        return 0.0 <= seconds_between(self.troubled_ns, now_ns) < QUIET_S

    def troubled_since(self, stamp_ns: int) -> bool:
        """Return whether something contradicted the commands since ``stamp_ns``."""
        return self.troubled_ns is not None and self.troubled_ns >= stamp_ns

    def restarted(self) -> 'MotionCheck':
        """Return the check that begins anew at the next view: the clock leapt."""
        return replace(self, reference=None, trouble='', suspected=False, asked=Asked())

    def updated(
        self, sight: Sight, sent: CommandsSent, settings: ServoSettings, *, drives: bool
    ) -> 'MotionCheck':
        """Return the check after one more view, of a robot that ``drives`` or holds."""
        observation, reference = sight.observation, self.reference
        if observation.ids is None:
            return self.restarted()
        here = Reference(observation.stamp_ns, observation.ids, observation.current)
        seen = None if reference is None else _seen(reference, here, sight.noise)
        if reference is None or seen is None:
            began = replace(self.restarted(), reference=here)
            return replace(began, now_ns=here.stamp_ns)
        window = Window(reference.stamp_ns, here.stamp_ns, sent)
        asked = Asked()
        if seen.stands:
            asked = self.asked.after(*self._told(sent, sight, here.stamp_ns), self.now_ns)
        suspicion = (
            _against(window, seen)
            or _moved(window, seen)
            or _standing(window, seen, sight.parallax_of_way, settings)
            or _standing_long(asked, seen, here.stamp_ns, numb=self.numb)
        )
        trouble = suspicion if self.suspected else ''
        lasted = seconds_between(reference.stamp_ns, here.stamp_ns)
        over = lasted >= LASTING_S and not seen.stands and not suspicion
        return MotionCheck(
            here if over or trouble else reference,
            trouble,
            bool(suspicion) and not trouble,
            here.stamp_ns if trouble else self.troubled_ns,
            self.contradictions + (bool(trouble) and drives),
            Asked() if trouble else asked,
            here.stamp_ns,
            seen.stands and (self.numb or bool(trouble)),
        )

    def _told(self, sent: CommandsSent, sight: Sight, now_ns: int) -> tuple[float, float]:
        """Return turn [rad] and parallax [rad] commanded since the last view."""
        turn = float(sent.turns(self.now_ns, now_ns, DELAYS[:1])[0])
        way = float(sent.ways(self.now_ns, now_ns, DELAYS[:1])[0])
        return turn, way * sight.parallax_of_way


class Window(NamedTuple):
    """Time between two views [ns], and the commands ``sent``."""

    begin_ns: int
    end_ns: int
    sent: CommandsSent

    @property
    def turns(self) -> FloatArray:
        """Turns commanded in it, less each of DELAYS: (N,) [rad]."""
        return self.sent.turns(self.begin_ns, self.end_ns, DELAYS)

    @property
    def ways(self) -> FloatArray:
        """Ways commanded in it, less each of DELAYS: (N,) [m]."""
        return self.sent.ways(self.begin_ns, self.end_ns, DELAYS)

    def unfollowed(self, axis: str, least: float) -> float:
        """Return what was commanded that any base follows by now, faster than ``least``."""
        began = self.sent.since([getattr(twist, axis) for twist in self.sent.twists], least)
        if began is None:
            return 0.0
        late_ns = round(MOST_DELAY_S * NANOSECONDS)
        begin_ns, end_ns = max(began, self.begin_ns - late_ns), self.end_ns - late_ns
        if end_ns <= begin_ns:
            return 0.0
        driven = self.sent.turns if axis == 'angular' else self.sent.ways
        late = np.array([0.0, MOST_DELAY_S])
        return float(np.abs(driven(begin_ns + late_ns, self.end_ns, late)).min())


def _seen(reference: Reference, here: Reference, noise: float) -> Seen | None:
    """Return the motion between two views; None where they cannot tell."""
    if here.stamp_ns <= reference.stamp_ns:
        return None
    _, now, before = np.intersect1d(
        here.ids, reference.ids, assume_unique=True, return_indices=True
    )
    # What is left of many may be those that are wrong.
    if len(now) < max(COMMON, COMMON_SHARE * len(reference.ids)):
        return None
    fit = fit_rotation(here.rays[now], reference.rays[before])
    return Seen(fit.heading_error, fit.parallax, max(NOISE_OF_PARALLAX * noise, 1e-9))


def _against(window: Window, seen: Seen) -> str:
    """Return how a turn contradicts all that was commanded; or ''."""
    turns, ways = window.turns, window.ways
    slack = LEAST_TURN + TURN_DEVIATIONS * seen.noise + TURN_OF_PARALLAX * seen.parallax
    slack += MOST_CURVATURE * float(np.abs(ways).max())
    low = MOST_TURN_RATIO * min(float(turns.min()), 0.0) - slack
    high = MOST_TURN_RATIO * max(float(turns.max()), 0.0) + slack
    if low <= seen.turn <= high:
        return ''
    soon = turns[DELAYS <= SOON_S]  # of one side: the other would have explained it
    ratios = -seen.turn / soon[np.abs(soon) > TOLD_TURN]
    turned = f'{seen.turn:.2f} rad to the left were seen'
    if ((ratios > AGAINST[0]) & (ratios < AGAINST[1])).any():
        return (
            f'the image turns against the command: upside down or mirrored? {turned}, '
            f'{soon[0]:.2f} were commanded; turn the camera, what its driver makes of images, or '
            'the wheels the right way round'
        )
    return (
        f'the robot turns as nobody told it: {turned}, {turns[0]:.2f} were commanded; look who '
        'else publishes cmd_vel or pushes it, and whether camera_info is of these images'
    )


def _moved(window: Window, seen: Seen) -> str:
    """Return that who was to stand was moved; or ''."""
    if window.turns.any() or window.ways.any() or seen.parallax < MOVED_PARALLAX * seen.noise:
        return ''
    return (
        'the robot moves while it is told to stand; look who else publishes cmd_vel or pushes it'
    )


def _standing(window: Window, seen: Seen, parallax_of_way: float, settings: ServoSettings) -> str:
    """Return what was commanded and not followed at all; or ''."""
    if not seen.stands:
        return ''
    turn = window.unfollowed('angular', max(FOLLOWED, LARGEST_DEAD_BAND * settings.max_angular))
    if turn > ASKED_TURN and abs(seen.turn) < SHARE * turn:
        return _deaf(f'a turn of {turn:.2f} rad')
    way = window.unfollowed('linear', max(FOLLOWED, LARGEST_DEAD_BAND * settings.max_linear))
    if way * parallax_of_way > ASKED_PARALLAX * seen.noise:
        return _deaf(f'a way of {way:.2f} m')
    return ''


def _standing_long(asked: Asked, seen: Seen, now_ns: int, *, numb: bool) -> str:
    """Return that slow commands were not followed for long; or ''."""
    if asked.since_ns is None or seconds_between(asked.since_ns, now_ns) < SLOWLY_S:
        return ''
    turn = abs(asked.turn)
    if numb and seconds_between(asked.since_ns, now_ns) > NUMB_S:
        return _deaf(f'a turn of {turn:.3f} rad')
    if turn > ASKED_SLOWLY * ASKED_TURN and abs(seen.turn) < SHARE * turn:
        return _deaf(f'a turn of {turn:.2f} rad')
    if abs(asked.parallax) > ASKED_SLOWLY * ASKED_PARALLAX * seen.noise:
        return _deaf('a way that would be seen')
    return ''


def _deaf(commanded: str) -> str:
    return (
        f'the base does not follow: {commanded} was commanded, and the view stands still; see '
        'that cmd_vel leads to the base, its type and its motors, and that no emergency stop is on'
    )
