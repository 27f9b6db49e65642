"""
Head check: whether rays that a head turned turn as encoder and commands say.

From one image to the next they turn as the base does. If not, the encoder slipped, the motor lost
steps or the robot was turned; no image tells which, so that the heading is unknown from then on.
"""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.estimate.verdicts import (
    beyond,
    CommandWindow,
    DELAYS,
    LEAST_TURN,
    Reference,
    SOON_S,
    TURN_DEVIATIONS,
    TURN_OF_PARALLAX,
    turn_of_way,
    unexplained_turn,
    view_motion,
    ViewMotion,
)
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent

TURNED_BACK = 0.3  # of a turn, after a single wrong reading
LONGEST_S = 1.0  # between two images that are compared
LEAST_SLIP = 0.02  # that ends a run [rad]
STAMPS_S = 0.02  # by which stamps of joints and images may be apart
LATELY = 0.9  # of the fastest rate, one image later
NOISES = 8.0  # of an encoder, of that turn
TURN_RATIOS = 0.5, 1.2  # of turns over those commanded; of worse wheels the noise is larger
NOISE, SMOOTHING = 0.004, 0.05  # of an unknown encoder [rad], weight of the newest


@dataclass(frozen=True, slots=True, eq=False)
class HeadCheck:
    """
    Check of a head's encoder since the ``previous`` view, None before the first.

    The pan joint was at ``pan`` then [rad], and had turned at a ``rate``, of late at the
    ``fastest`` [rad/s]. ``slip`` says how a turn contradicts them for good: one view ``suspected``
    a turn [rad], and the next did not turn back, as after a single wrong reading. ``noise`` is the
    mean size of what turns leave unexplained [rad].
    """

    previous: Reference | None = None
    pan: float = 0.0
    rate: float = 0.0
    fastest: float = 0.0
    suspected: float = 0.0
    noise: float = NOISE
    slip: str = ''

    def updated(
        self, here: Reference, pan: float, sent: CommandsSent, *, ray_noise: float, latency: float
    ) -> 'HeadCheck':
        """Return the check after one more view, of a base that obeys with a ``latency`` [s]."""
        anew = replace(self, previous=here, pan=pan, rate=0.0, suspected=0.0)
        if self.previous is None or self.slip:
            return anew
        window = CommandWindow(self.previous.stamp_ns, here.stamp_ns, sent)
        seen = view_motion(self.previous, here, ray_noise) if window.seconds < LONGEST_S else None
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
            return HeadCheck(here, pan, rate, fastest, noise=noise, slip=slip)
        suspected = left if abs(left) > limit + by_stamps else 0.0
        return HeadCheck(here, pan, rate, fastest, suspected, noise)

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
