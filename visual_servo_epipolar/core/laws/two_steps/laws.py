"""Two steps: the laws of the paper, which zero the epipoles, then match the features."""

from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws.law import Law
from visual_servo_epipolar.core.laws.machine import StateMachine
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.phases.displacing import DISPLACING
from visual_servo_epipolar.core.laws.phases.matching_features import MATCHING_FEATURES
from visual_servo_epipolar.core.laws.phases.orienting import ORIENTING
from visual_servo_epipolar.core.laws.phases.retreating import RETREATING
from visual_servo_epipolar.core.laws.phases.standing import STANDING
from visual_servo_epipolar.core.laws.phases.zeroing_epipoles import ZEROING_EPIPOLES


def transitions_by(drive: Phase) -> dict[tuple[Phase, Event], Phase]:
    """Return the transitions that laws share, whose way to the goal begins with ``drive``."""
    survey = {  # of the situation: at the start, and after tracks came back
        Event.SIDEWAYS: Phase.RETREATING,
        Event.APART: drive,
        Event.ALIGNED: Phase.MATCHING_FEATURES,
        Event.MATCHED: Phase.ARRIVED,
    }
    standing = {
        Event.NO_BASELINE: Phase.ORIENTING,
        Event.AMBIGUOUS: Phase.MATCHING_FEATURES,
        Event.AMBIGUOUS_NEAR: Phase.RETREATING,
        **survey,
    }
    return {
        **{(Phase.WAITING, event): phase for event, phase in standing.items()},
        **{(Phase.HOLDING, event): phase for event, phase in standing.items()},
        **{(Phase.ORIENTING, event): phase for event, phase in survey.items()},
        (Phase.RETREATING, Event.APART): drive,
        (Phase.RETREATING, Event.RESOLVED): Phase.HOLDING,
        (Phase.MATCHING_FEATURES, Event.RESOLVED): Phase.HOLDING,
        (Phase.MATCHING_FEATURES, Event.NO_GAIN): Phase.FAILED,
        (Phase.MATCHING_FEATURES, Event.MATCHED): Phase.ARRIVED,
        (Phase.MATCHING_FEATURES, Event.TURNED): Phase.ORIENTING,
        (Phase.MATCHING_FEATURES, Event.MISSED): Phase.RETREATING,
    }


TWO_STEPS = StateMachine(
    (*STANDING, ORIENTING, RETREATING, DISPLACING, ZEROING_EPIPOLES, MATCHING_FEATURES),
    {
        **transitions_by(Phase.DISPLACING),
        (Phase.RETREATING, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.DISPLACING, Event.DISPLACED): Phase.ZEROING_EPIPOLES,
        (Phase.DISPLACING, Event.NO_GAIN): Phase.FAILED,
        (Phase.ZEROING_EPIPOLES, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.ZEROING_EPIPOLES, Event.SIDEWAYS): Phase.RETREATING,
        (Phase.ZEROING_EPIPOLES, Event.ESCAPED): Phase.DISPLACING,
        (Phase.ZEROING_EPIPOLES, Event.NO_BASELINE): Phase.ORIENTING,
        (Phase.ZEROING_EPIPOLES, Event.NO_GAIN): Phase.DISPLACING,
    },
)

PAPER = Law(new_attempts=True)
CORRECTED = PAPER.changed({'true_sigma': True})
FULL = PAPER.changed(dict.fromkeys(DEPARTURES, True))
