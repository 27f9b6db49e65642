"""
Motion check: whether the base moves as commanded, by how the view changes.

The turn and the parallax between two views of the run hold whatever the photograph, the scale of
a memory and the distance are. They are held against what commands make of a base that obeys at
once, or up to MOST_DELAY_S late. A base that stands where a motion was commanded does not follow;
one that turns otherwise is driven by somebody else, or seen through a wrong or mirrored camera.

A turn is always seen. A way is seen where the photograph shows that there is parallax to be seen:
not in a scene too far away for it, nor near the goal, nor for a command that is a matter of the
dead band.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.estimate.verdicts import (
    Asked,
    CommandWindow,
    contradiction,
    HeadCheck,
    Reference,
    view_motion,
)
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.stamps import seconds_between

LASTING_S = 1.0  # of a reference, if anything moved since
QUIET_S = 1.0  # after a contradiction, before the run may go on
MOST_CONTRADICTIONS = 3  # in a run
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
