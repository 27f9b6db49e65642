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

from visual_servo_epipolar.core.arrays import FloatArray, ROUNDING
from visual_servo_epipolar.core.estimate.base_model import (
    DELAYS,
    largest_dead_band,
    MOST_CONTRADICTIONS,
    MOST_CURVATURE,
    MOST_DELAY_S,
    MOST_TURN_RATIO,
    SOON_S,
)
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import MIN_MATCHES
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.stamps import MOST_GAP_S, seconds_between
from visual_servo_epipolar.core.twoview.observation import Observation

COMMON_SHARE = 0.4  # of the first one's features, that two views must have in common
NOISE_OF_PARALLAX = 1.2  # of two views of one place, in deviations of a coordinate
STANDING_TURN, STANDING_PARALLAX = 0.015, 2.5  # of a standing robot at most [rad], [deviations]
TURN_DEVIATIONS = 6.0  # that a turn between two views may be wrong by, of a parallax
ASKED_TURN, MOVED_PARALLAX = 0.1, 11.0  # that are certainly seen, if made [rad], [deviations]
# For how long slow commands, that a dead band may swallow, are not followed at least [s]; any at
# all, by a base that did not follow before, nor has moved since, for twice as long.
SLOWLY_S = 3.0
# By which a turn may differ from commands: at least [rad], and in parallax, which a rotation alone
# explains wrong.
LEAST_TURN, TURN_OF_PARALLAX = 0.04, 1.5
AGAINST = 0.4, 2.5  # turns seen over turns commanded, of an image that turns against commands
TURNED_BACK = 0.3  # of a turn, after a single wrong reading
LEAST_SLIP = 0.02  # that ends a run [rad]
STAMPS_S = 0.02  # by which stamps of joints and images may be apart
LATELY = 0.9  # of the fastest rate, one image later
LEAP = 3.0  # times the usual parallax: no slip changes it, look-alikes of another place do
NOISES = 8.0  # of an encoder, of that turn
# Turns over those commanded: of any base, and of one of which more is noise of the encoder.
ANY_RATIO, USUAL_RATIO = (0.0, MOST_TURN_RATIO), (0.5, 1.2)
NOISE, SMOOTHING = 0.004, 0.05  # of an unknown encoder [rad], weight of the newest


class Evidence(NamedTuple):
    """What an image shows: noise of a ray [rad], parallax of a metre [rad/m], 0 while unknown."""

    observation: Observation
    noise: float
    parallax_of_way: float


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


def view_motion(before: Observation, now: Observation, noise: float) -> ViewMotion | None:
    """Return the motion between two views; None where they cannot tell."""
    if before.ids is None or now.ids is None or now.stamp_ns <= before.stamp_ns:
        return None
    _, here, there = np.intersect1d(now.ids, before.ids, assume_unique=True, return_indices=True)
    # What is left of many may be those that are wrong.
    if len(here) < max(MIN_MATCHES, COMMON_SHARE * len(before)):
        return None
    fit = fit_rotation(now.current[here], before.current[there])
    return ViewMotion(fit.heading_error, fit.parallax, max(NOISE_OF_PARALLAX * noise, ROUNDING))


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

    def unexplained(
        self, turn: float, slack: float, ratios: tuple[float, float], most: float = MOST_DELAY_S
    ) -> float:
        """
        Return what commands leave of a ``turn``, signed [rad], beyond a ``slack``.

        The base makes of what is commanded between the ``ratios``, late by at ``most`` so much.
        """
        turns = self.turns[most >= DELAYS]
        low = min(ratio * float(turns.min()) for ratio in ratios) - slack
        high = max(ratio * float(turns.max()) for ratio in ratios) + slack
        return min(turn - low, 0.0) + max(turn - high, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """
    Turns [rad] and ways [m] commanded while the view stood, since the first of them.

    Both have shape (2,): of a base that obeys at once, and of one that is as late as any.
    ``unresponsive`` says that the base stood where it had to move, and has not moved since.
    ``dead_band`` is what it does not follow, as far as is known [m/s, rad/s]: another one is to
    be tried first.
    """

    since_ns: int | None = None
    turns: FloatArray = field(default_factory=lambda: np.zeros(2))
    ways: FloatArray = field(default_factory=lambda: np.zeros(2))
    unresponsive: bool = False
    dead_band: tuple[float, float] = (0.0, 0.0)

    def after(self, window: CommandWindow, settings: DriveSettings) -> 'Asked':
        """Return what was asked with the commands of a ``window`` more; a gap begins anew."""
        dead_band = settings.dead_band_linear, settings.dead_band_angular
        before, gap = self, window.seconds >= MOST_GAP_S  # in which a base stops by itself
        if gap or dead_band != self.dead_band:
            before = Asked(unresponsive=self.unresponsive, dead_band=dead_band)
        if gap:
            return before
        turns, ways = window.turns[[0, -1]], window.ways[[0, -1]]
        if before.since_ns is None and not turns[0] and not ways[0]:
            return before
        return replace(
            before,
            since_ns=window.begin_ns if before.since_ns is None else before.since_ns,
            turns=before.turns + turns,
            ways=before.ways + ways,
        )

    def unfollowed(
        self, seen: ViewMotion, now_ns: int, parallax_of_way: float, settings: DriveSettings
    ) -> str:
        """Return in words what a base that stands had to follow by now; or ''."""
        lasted = 0.0 if self.since_ns is None else seconds_between(self.since_ns, now_ns)
        if self.unresponsive and lasted > 2.0 * SLOWLY_S:
            return _not_followed('a slow motion')

        def is_due(asked: FloatArray, limit: float) -> bool:
            """Whether it lasted long, or any base follows commands as fast as these."""
            fast = abs(asked[0]) > largest_dead_band(limit) * lasted
            return bool(fast) or lasted >= SLOWLY_S

        turn, way = (float(np.abs(asked).min()) for asked in (self.turns, self.ways))
        if turn > ASKED_TURN and is_due(self.turns, settings.max_angular):
            return _not_followed(f'a turn of {turn:.2f} rad')
        shows = way * parallax_of_way > MOVED_PARALLAX * seen.noise
        if shows and is_due(self.ways, settings.max_linear):
            return _not_followed(f'a motion of {way:.2f} m')
        return ''


def _not_followed(commanded: str) -> str:
    return (
        f'the base does not follow: {commanded} was commanded, and the view stands still; check '
        'that cmd_vel reaches the base and has its message type, that its motors are on, and that '
        'no emergency stop is pressed'
    )


def contradiction(window: CommandWindow, seen: ViewMotion) -> str:
    """Return how a base that moved contradicts the commands; or ''."""
    turns, ways = window.turns, window.ways
    if not turns.any() and not ways.any() and seen.parallax >= MOVED_PARALLAX * seen.noise:
        return (
            'the robot moves although no motion is commanded; check whether something else '
            'publishes cmd_vel or pushes the robot'
        )
    left = window.unexplained(seen.turn, TURN_DEVIATIONS * seen.noise, ANY_RATIO)
    if abs(left) <= LEAST_TURN + turn_of_way(window, seen):
        return ''
    soon = turns[DELAYS <= SOON_S]  # of one side: the other would have explained it
    ratios = -seen.turn / soon[np.abs(soon) > STANDING_TURN]
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


def turn_of_way(window: CommandWindow, seen: ViewMotion) -> float:
    """Return the turn that a way makes, of unequal wheels or by its parallax [rad]."""
    curved = MOST_CURVATURE * float(np.abs(window.ways).max())
    return curved + TURN_OF_PARALLAX * seen.parallax


@dataclass(frozen=True, slots=True, eq=False)
class HeadCheck:
    """
    Check of a head's encoder since the ``previous`` view, None before the first.

    The pan joint was at ``pan`` then [rad], and had turned at a ``rate``, of late at the
    ``fastest`` [rad/s]. ``slip`` says how a turn contradicts them for good: one view ``suspected``
    a turn [rad], and the next did not turn back, as after a single wrong reading. ``noise`` is the
    mean size of what turns leave unexplained [rad], ``parallax`` that between the last two views.
    """

    previous: Observation | None = None
    pan: float = 0.0
    rate: float = 0.0
    fastest: float = 0.0
    suspected: float = 0.0
    noise: float = NOISE
    parallax: float = 0.0
    slip: str = ''

    def updated(
        self, pan: float, evidence: Evidence, sent: CommandsSent, latency: float
    ) -> 'HeadCheck':
        """Return the check after one more view, of a base that obeys with a ``latency`` [s]."""
        here = evidence.observation
        anew = replace(self, previous=here, pan=pan, rate=0.0, suspected=0.0)
        if self.previous is None or self.slip:
            return anew
        window = CommandWindow(self.previous.stamp_ns, here.stamp_ns, sent)
        fits = window.seconds < MOST_GAP_S
        seen = view_motion(self.previous, here, evidence.noise) if fits else None
        return anew if seen is None else self._judge(anew, window, seen, evidence, latency)

    def _judge(
        self,
        anew: 'HeadCheck',
        window: CommandWindow,
        seen: ViewMotion,
        evidence: Evidence,
        latency: float,
    ) -> 'HeadCheck':
        """Return the check after what was ``seen`` since the previous view."""
        latest, turns = latency + SOON_S, window.turns[latency + SOON_S >= DELAYS]
        left, rest = (
            window.unexplained(seen.turn, slack, USUAL_RATIO, latest)
            for slack in (TURN_DEVIATIONS * seen.noise, TURN_OF_PARALLAX * seen.parallax)
        )
        limit = max(LEAST_SLIP, NOISES * self.noise, USUAL_RATIO[0] * float(np.abs(turns).max()))
        rate = (anew.pan - self.pan) / window.seconds
        by_stamps = STAMPS_S * abs(rate - self.rate)
        off = min(max(abs(rest) - by_stamps, 0.0), limit)
        after = replace(
            anew,
            rate=rate,
            fastest=max(abs(rate), LATELY * self.fastest),
            noise=self.noise + SMOOTHING * (off - self.noise),
            parallax=seen.parallax,
        )
        limit += by_stamps
        if self.suspected:
            back = -left * math.copysign(1.0, self.suspected) > TURNED_BACK * abs(self.suspected)
            lasts = not back and abs(self.suspected) > limit
            return replace(after, slip=_slip(self.suspected) if lasts else '')
        usual = self.parallax + evidence.parallax_of_way * float(np.abs(window.ways).max())
        if abs(left) <= limit:
            return after
        if seen.parallax > LEAP * usual + MOVED_PARALLAX * seen.noise:
            return replace(anew, previous=None, parallax=0.0)  # no slip: features of another place
        return replace(after, suspected=left)

    def since(self, before: Observation, evidence: Evidence, sent: CommandsSent) -> 'HeadCheck':
        """Return the check where a turn since ``before`` contradicted commands for longer."""
        here = evidence.observation
        seen = view_motion(before, here, evidence.noise)
        if self.slip or seen is None:
            return self
        window = CommandWindow(before.stamp_ns, here.stamp_ns, sent)
        left = window.unexplained(seen.turn, TURN_DEVIATIONS * seen.noise, ANY_RATIO)
        limit = LEAST_TURN + turn_of_way(window, seen) + STAMPS_S * self.fastest
        return replace(self, slip=_slip(left)) if abs(left) > limit else self


def _slip(left: float) -> str:
    return (
        f'the view turned by {left:+.3f} rad to the left more than commanded and the '
        'head says: its encoder slipped, its motor lost steps, or somebody turned the robot, and '
        'no image tells which; set the encoder as it was at the photograph, and call ~/reset'
    )


NOTHING = Asked()


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

    reference: Observation | None = None
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
        return 0.0 <= seconds_between(self.troubled_ns, now_ns) < MOST_GAP_S

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
        after = self._since_reference(evidence, sent, settings, drives=drives)
        if observation.joints is None:
            return after
        head = self.head.updated(observation.joints.pan, evidence, sent, settings.latency)
        if head.previous is None:
            return replace(self.restarted(), head=head)
        if after.trouble and self.reference is not None:
            head = head.since(self.reference, evidence, sent)
        if not head.slip:
            return replace(after, head=head)
        return replace(after, trouble=head.slip, troubled_ns=observation.stamp_ns, head=head)

    def _since_reference(
        self, evidence: Evidence, sent: CommandsSent, settings: DriveSettings, *, drives: bool
    ) -> 'MotionCheck':
        """Return the check of the base after one more view."""
        here, reference = evidence.observation, self.reference
        now_ns = here.stamp_ns
        seen = None if reference is None else view_motion(reference, here, evidence.noise)
        if reference is None or seen is None:
            return replace(self.restarted(), reference=here, now_ns=now_ns)
        window, asked = CommandWindow(reference.stamp_ns, now_ns, sent), NOTHING
        found = contradiction(window, seen)
        if seen.stands:
            asked = self.asked.after(CommandWindow(self.now_ns, now_ns, sent), settings)
            shown = evidence.parallax_of_way
            found = found or asked.unfollowed(seen, now_ns, shown, settings)
        trouble = found if self.suspected else ''
        over = window.seconds >= MOST_GAP_S and not seen.stands and not found
        return MotionCheck(
            here if over or trouble else reference,
            trouble,
            bool(found) and not trouble,
            now_ns if trouble else self.troubled_ns,
            self.contradictions + (bool(trouble) and drives),
            Asked(unresponsive=seen.stands) if trouble else asked,
            now_ns,
        )
