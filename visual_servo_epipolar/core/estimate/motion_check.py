"""
Motion check: whether the base moves as commanded, by how the view changes.

The turn and the parallax between two views of the run hold whatever the photograph, the scale of
a memory and the distance are. They are held against what commands make of a base that obeys at
once, or up to MOST_DELAY_S late. A base that stands where a motion was commanded does not follow;
one that turns otherwise is driven by something else, or seen through a wrong or mirrored camera.

A turn is always seen. A way is seen where the photograph shows that there is parallax to be seen:
not in a scene too far away for it, nor near the goal, nor for a command that is a matter of the
dead band. Rays that a head turned turn, from one image to the next, as the base does. If not, the
encoder slipped, the motor lost steps or the robot was turned; no image tells which, so that the
heading is unknown from then on.
"""

from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray, ROUNDING
from visual_servo_epipolar.core.estimate.base_model import (
    largest_dead_band,
    MOST_CONTRADICTIONS,
    MOST_CURVATURE,
    MOST_DELAY_S,
    MOST_TURN_RATIO,
)
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.stamps import MOST_GAP_S, NANOSECONDS, seconds_between
from visual_servo_epipolar.core.twoview.observation import Observation

COMMON, COMMON_SHARE = 8, 0.4  # features that two views must have in common, of the first one's
NOISE_OF_PARALLAX = 1.2  # of two views of one place, in deviations of a coordinate
STANDING_TURN, STANDING_PARALLAX = 0.015, 2.5  # of a standing robot at most [rad], [deviations]
TURN_DEVIATIONS = 6.0  # that a turn between two views may be wrong by, of a parallax
DELAYS: FloatArray = np.linspace(0.0, MOST_DELAY_S, 16)  # [s]
ASKED_TURN, ASKED_PARALLAX = 0.1, 10.0  # that show a standing robot [rad], [deviations]
# The same of slow commands, of which a dead band may swallow some, and for how long at least [s].
ASKED_SLOWLY, SLOWLY_S = 1.5, 3.0
UNRESPONSIVE_S = 6.0  # of any commands, to a base that did not follow, nor has moved since [s]
SHARE = 0.25  # of what was commanded, that a standing robot moves at most
# By which a turn may differ from commands: at least [rad], and in parallax, which a rotation alone
# explains wrong.
LEAST_TURN, TURN_OF_PARALLAX = 0.04, 1.5
AGAINST = 0.4, 2.5  # turns seen over turns commanded, of an image that turns against commands
SOON_S, TOLD_TURN = 0.5, 0.01  # in which a base usually follows, and a turn that counts [rad]
MOVED_PARALLAX = 12.0  # of a robot moved while it was to stand [deviations]
TURNED_BACK = 0.3  # of a turn, after a single wrong reading
LEAST_SLIP = 0.02  # that ends a run [rad]
STAMPS_S = 0.02  # by which stamps of joints and images may be apart
LATELY = 0.9  # of the fastest rate, one image later
LEAP = 3.0  # times the usual parallax: no slip changes it, look-alikes of another place do
NOISES = 8.0  # of an encoder, of that turn
TURN_RATIOS = 0.5, 1.2  # of turns over those commanded; of worse wheels the noise is larger
NOISE, SMOOTHING = 0.004, 0.05  # of an unknown encoder [rad], weight of the newest
LASTING_S = 1.0  # of a reference, if anything moved since
QUIET_S = 1.0  # after a contradiction, before the run may go on


class Reference(NamedTuple):
    """View at ``stamp_ns``: ``ids``, (N,), and unit rays, (N, 3), of its features."""

    stamp_ns: int
    ids: IntArray
    rays: FloatArray


class ViewMotion(NamedTuple):
    """Motion between two views: ``turn``, left positive, ``parallax`` and its ``noise`` [rad]."""

    turn: float
    parallax: float
    noise: float

    @property
    def stands(self) -> bool:
        """Whether nothing moved."""
        within = abs(self.turn) < STANDING_TURN + TURN_DEVIATIONS * self.noise
        return within and self.parallax < STANDING_PARALLAX * self.noise


def view_motion(reference: Reference, here: Reference, noise: float) -> ViewMotion | None:
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
    return ViewMotion(fit.heading_error, fit.parallax, max(NOISE_OF_PARALLAX * noise, ROUNDING))


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """
    Turns [rad] and parallaxes [rad] commanded while the view stood, since the first of them.

    Both have shape (2,): of a base that obeys at once, and of one that is as late as any.
    ``unresponsive`` says that the base stood where it had to move, and has not moved since.
    ``dead_band`` is what it does not follow, as far as is known [m/s, rad/s]: another one is to
    be tried first.
    """

    since_ns: int | None = None
    turns: FloatArray = field(default_factory=lambda: np.zeros(2))
    parallaxes: FloatArray = field(default_factory=lambda: np.zeros(2))
    unresponsive: bool = False
    dead_band: tuple[float, float] = (0.0, 0.0)

    def below(self, dead_band: tuple[float, float]) -> 'Asked':
        """Return what was asked of a base with that ``dead_band``."""
        if dead_band == self.dead_band:
            return self
        return Asked(unresponsive=self.unresponsive, dead_band=dead_band)

    def after(self, window: 'CommandWindow', parallax_of_way: float) -> 'Asked':
        """Return what was asked with the commands of a ``window`` more."""
        turns, ways = window.turns[[0, -1]], window.ways[[0, -1]]
        if self.since_ns is None and not turns[0] and not ways[0]:
            return self
        return Asked(
            window.begin_ns if self.since_ns is None else self.since_ns,
            self.turns + turns,
            self.parallaxes + parallax_of_way * ways,
            self.unresponsive,
            self.dead_band,
        )

    def seconds(self, now_ns: int) -> float:
        """Return for how long something has been asked [s]."""
        return 0.0 if self.since_ns is None else seconds_between(self.since_ns, now_ns)


class CommandWindow(NamedTuple):
    """Time between two views [ns], and the commands ``sent``."""

    begin_ns: int
    end_ns: int
    sent: CommandsSent

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return seconds_between(self.begin_ns, self.end_ns)

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


def contradiction(
    window: CommandWindow,
    seen: ViewMotion,
    asked: Asked,
    parallax_of_way: float,
    settings: DriveSettings,
) -> str:
    """Return how what was ``seen`` contradicts the commands; or ''."""
    trouble = _against(window, seen) or _moved(window, seen)
    if trouble or not seen.stands:
        return trouble
    return _standing(window, seen, parallax_of_way, settings) or _standing_long(
        window, seen, asked
    )


def unexplained_turn(window: CommandWindow, seen: ViewMotion) -> float:
    """Return what commands and noise leave unexplained of a turn, signed [rad]."""
    turns, slack = window.turns, TURN_DEVIATIONS * seen.noise
    low = MOST_TURN_RATIO * min(float(turns.min()), 0.0) - slack
    high = MOST_TURN_RATIO * max(float(turns.max()), 0.0) + slack
    return beyond(seen.turn, low, high)


def beyond(value: float, low: float, high: float) -> float:
    """Return by how much a value is below ``low``, negative, or above ``high``."""
    return min(value - low, 0.0) + max(value - high, 0.0)


def turn_of_way(window: CommandWindow, seen: ViewMotion) -> float:
    """Return the turn that a way makes, of unequal wheels or by its parallax [rad]."""
    curved = MOST_CURVATURE * float(np.abs(window.ways).max())
    return curved + TURN_OF_PARALLAX * seen.parallax


def _against(window: CommandWindow, seen: ViewMotion) -> str:
    """Return how a turn contradicts all that was commanded; or ''."""
    if abs(unexplained_turn(window, seen)) <= LEAST_TURN + turn_of_way(window, seen):
        return ''
    turns = window.turns
    soon = turns[DELAYS <= SOON_S]  # of one side: the other would have explained it
    ratios = -seen.turn / soon[np.abs(soon) > TOLD_TURN]
    if ((ratios > AGAINST[0]) & (ratios < AGAINST[1])).any():
        return (
            f'the image turns against the command: upside down or mirrored? {seen.turn:.2f} rad '
            f'to the left were seen, {soon[0]:.2f} were commanded; mount the camera upright, stop '
            'its driver from flipping images, or correct the direction of the wheels'
        )
    return (
        f'the robot turns otherwise than commanded: {seen.turn:.2f} rad to the left were seen, '
        f'{turns[0]:.2f} were commanded; check whether something else publishes cmd_vel or pushes '
        'the robot, and whether camera_info belongs to these images'
    )


def _moved(window: CommandWindow, seen: ViewMotion) -> str:
    """Return that a robot that was to stand was moved; or ''."""
    if window.turns.any() or window.ways.any() or seen.parallax < MOVED_PARALLAX * seen.noise:
        return ''
    return (
        'the robot moves although no motion is commanded; check whether something else publishes '
        'cmd_vel or pushes the robot'
    )


def _standing(
    window: CommandWindow, seen: ViewMotion, parallax_of_way: float, settings: DriveSettings
) -> str:
    """Return what was commanded and not followed at all; or ''."""
    turn = window.unfollowed('angular', largest_dead_band(settings.max_angular))
    if turn > ASKED_TURN and abs(seen.turn) < SHARE * turn:
        return _not_followed(f'a turn of {turn:.2f} rad')
    way = window.unfollowed('linear', largest_dead_band(settings.max_linear))
    if way * parallax_of_way > ASKED_PARALLAX * seen.noise:
        return _not_followed(f'a motion of {way:.2f} m')
    return ''


def _standing_long(window: CommandWindow, seen: ViewMotion, asked: Asked) -> str:
    """Return that slow commands were not followed for long; or ''."""
    lasted = asked.seconds(window.end_ns)
    turn, parallax = (float(np.abs(each).min()) for each in (asked.turns, asked.parallaxes))
    if asked.unresponsive and lasted > UNRESPONSIVE_S:
        return _not_followed('a slow motion')
    if lasted < SLOWLY_S:
        return ''
    if turn > ASKED_SLOWLY * ASKED_TURN and abs(seen.turn) < SHARE * turn:
        return _not_followed(f'a turn of {turn:.2f} rad')
    if parallax > ASKED_SLOWLY * ASKED_PARALLAX * seen.noise:
        return _not_followed('a visible motion')
    return ''


def _not_followed(commanded: str) -> str:
    return (
        f'the base does not follow: {commanded} was commanded, and the view stands still; check '
        'that cmd_vel reaches the base and has its message type, that its motors are on, and that '
        'no emergency stop is pressed'
    )


@dataclass(frozen=True, slots=True, eq=False)
class HeadCheck:
    """
    Check of a head's encoder since the ``previous`` view, None before the first.

    The pan joint was at ``pan`` then [rad], and had turned at a ``rate``, of late at the
    ``fastest`` [rad/s]. ``slip`` says how a turn contradicts them for good: one view ``suspected``
    a turn [rad], and the next did not turn back, as after a single wrong reading. ``noise`` is the
    mean size of what turns leave unexplained [rad], ``parallax`` that between the last two views.
    """

    previous: Reference | None = None
    pan: float = 0.0
    rate: float = 0.0
    fastest: float = 0.0
    suspected: float = 0.0
    noise: float = NOISE
    parallax: float = 0.0
    slip: str = ''

    def updated(
        self,
        here: Reference,
        pan: float,
        sent: CommandsSent,
        *,
        ray_noise: float,
        parallax_of_way: float,
        latency: float,
    ) -> 'HeadCheck':
        """Return the check after one more view, of a base that obeys with a ``latency`` [s]."""
        anew = replace(self, previous=here, pan=pan, rate=0.0, suspected=0.0)
        if self.previous is None or self.slip:
            return anew
        window = CommandWindow(self.previous.stamp_ns, here.stamp_ns, sent)
        seen = view_motion(self.previous, here, ray_noise) if window.seconds < MOST_GAP_S else None
        if seen is None:
            return anew
        rate = (pan - self.pan) / window.seconds
        left, most = _unexplained(window, seen, latency)
        rest, _ = _unexplained(window, seen, latency, slack=TURN_OF_PARALLAX * seen.parallax)
        limit = max(LEAST_SLIP, NOISES * self.noise, TURN_RATIOS[0] * most)
        fastest = max(abs(rate), LATELY * self.fastest)
        by_stamps = STAMPS_S * abs(rate - self.rate)
        noise = self.noise + SMOOTHING * (min(max(abs(rest) - by_stamps, 0.0), limit) - self.noise)
        if self.suspected:
            back = -left * math.copysign(1.0, self.suspected) > TURNED_BACK * abs(self.suspected)
            lasts = not back and abs(self.suspected) > limit + by_stamps
            slip = _slip(self.suspected) if lasts else ''
            return HeadCheck(here, pan, rate, fastest, 0.0, noise, seen.parallax, slip)
        suspected = left if abs(left) > limit + by_stamps else 0.0
        usual = self.parallax + parallax_of_way * float(np.abs(window.ways).max())
        if suspected and seen.parallax > LEAP * usual + MOVED_PARALLAX * seen.noise:
            return replace(anew, previous=None, parallax=0.0)  # no slip: features of another place
        return HeadCheck(here, pan, rate, fastest, suspected, noise, seen.parallax)

    def since(
        self, before: Reference, here: Reference, ray_noise: float, sent: CommandsSent
    ) -> 'HeadCheck':
        """Return the check where a turn since ``before`` contradicted commands for longer."""
        seen = view_motion(before, here, ray_noise)
        window = CommandWindow(before.stamp_ns, here.stamp_ns, sent)
        if self.slip or seen is None:
            return self
        left = unexplained_turn(window, seen)
        limit = LEAST_TURN + turn_of_way(window, seen) + STAMPS_S * self.fastest
        if abs(left) <= limit:
            return self
        return replace(self, slip=_slip(left))


def _unexplained(
    window: CommandWindow, seen: ViewMotion, latency: float, *, slack: float | None = None
) -> tuple[float, float]:
    """Return what is left of a turn, signed, and the largest that was commanded [rad]."""
    turns = window.turns[latency + SOON_S >= DELAYS]
    slack = TURN_DEVIATIONS * seen.noise if slack is None else slack
    low, high = float(turns.min()), float(turns.max())
    left = beyond(
        seen.turn, TURN_RATIOS[low < 0.0] * low - slack, TURN_RATIOS[high > 0.0] * high + slack
    )
    return left, max(high, -low)


def _slip(left: float) -> str:
    return (
        f'the view turned by {left:+.3f} rad to the left more than commanded and the '
        'head says: its encoder slipped, its motor lost steps, or somebody turned the robot, and '
        'no image tells which; set the encoder as it was at the photograph, and call ~/reset'
    )


NOTHING = Asked()


class Evidence(NamedTuple):
    """What an image shows: noise of a ray [rad], parallax of a metre [rad/m], 0 while unknown."""

    observation: Observation
    noise: float
    parallax_of_way: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionCheck:
    """
    Check of the motion since a ``reference``, None before the first view.

    ``trouble`` says what contradicts the commands now, '' if nothing does: two views in a row, of
    which the first made it ``suspected``. ``troubled_ns`` is when something did last, None before,
    and ``contradictions`` how often it stopped the run.
    ``asked`` is what was commanded while the view stood, until ``now_ns``; ``head``, the check of
    a head's encoder.
    """

    reference: Reference | None = None
    trouble: str = ''
    suspected: bool = False
    troubled_ns: int | None = None
    contradictions: int = 0
    asked: Asked = NOTHING
    now_ns: int = 0
    head: HeadCheck = HeadCheck()

    @property
    def is_final(self) -> bool:
        """Whether it has happened too often for the run to go on, or the heading is unknown."""
        return bool(self.head.slip) or self.contradictions >= MOST_CONTRADICTIONS

    @property
    def view_moves(self) -> bool:
        """Whether the last view differs from its reference, unless the robot was to stand."""
        return self.reference is not None and self.asked.since_ns is None

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
        return replace(self, reference=None, trouble='', suspected=False, asked=NOTHING)

    def updated(
        self, evidence: Evidence, sent: CommandsSent, settings: DriveSettings, *, drives: bool
    ) -> 'MotionCheck':
        """Return the check after one more view, of a robot that ``drives`` or holds."""
        observation = evidence.observation
        if observation.ids is None or len(observation) < settings.min_features:
            return self.restarted()  # a few may all be wrong
        here = Reference(observation.stamp_ns, observation.ids, observation.current)
        after = self._since_reference(here, evidence, sent, settings, drives=drives)
        if observation.joints is None:
            return after
        head = self.head.updated(
            here,
            observation.joints.pan,
            sent,
            ray_noise=evidence.noise,
            parallax_of_way=evidence.parallax_of_way,
            latency=settings.latency,
        )
        if head.previous is None:
            return replace(self.restarted(), head=head)
        if after.trouble and self.reference is not None:
            head = head.since(self.reference, here, evidence.noise, sent)
        if not head.slip:
            return replace(after, head=head)
        return replace(after, trouble=head.slip, troubled_ns=here.stamp_ns, head=head)

    def _since_reference(
        self,
        here: Reference,
        evidence: Evidence,
        sent: CommandsSent,
        settings: DriveSettings,
        *,
        drives: bool,
    ) -> 'MotionCheck':
        """Return the check of the base after one more view."""
        reference = self.reference
        seen = reference and view_motion(reference, here, evidence.noise)
        if reference is None or seen is None:
            return replace(self.restarted(), reference=here, now_ns=here.stamp_ns)
        window = CommandWindow(reference.stamp_ns, here.stamp_ns, sent)
        asked = NOTHING
        if seen.stands:
            last = CommandWindow(self.now_ns, here.stamp_ns, sent)
            dead_band = settings.dead_band_linear, settings.dead_band_angular
            asked = self.asked.below(dead_band).after(last, evidence.parallax_of_way)
        found = contradiction(window, seen, asked, evidence.parallax_of_way, settings)
        trouble = found if self.suspected else ''
        lasted = seconds_between(reference.stamp_ns, here.stamp_ns)
        over = lasted >= LASTING_S and not seen.stands and not found
        return MotionCheck(
            here if over or trouble else reference,
            trouble,
            bool(found) and not trouble,
            here.stamp_ns if trouble else self.troubled_ns,
            self.contradictions + (bool(trouble) and drives),
            Asked(unresponsive=seen.stands) if trouble else asked,
            here.stamp_ns,
        )
