"""Words for what the servo does in a phase, and for the event that led there."""

from collections.abc import Mapping
from types import MappingProxyType

from visual_servo_epipolar.core.laws.phases.table import Event, Phase

PHASE_WORDS: Mapping[Phase, str] = MappingProxyType(
    {
        Phase.WAITING: 'the robot stands',
        Phase.ORIENTING: 'the robot turns in place to the heading of the photograph',
        Phase.RETREATING: 'the robot backs off, to come in from behind',
        Phase.DISPLACING: 'the robot turns, to begin step 1 with the goal on the right side',
        Phase.ZEROING_EPIPOLES: 'step 1: the robot drives onto the axis of the photograph',
        Phase.MATCHING_FEATURES: 'step 2: the robot drives straight until the features match',
        Phase.ARRIVED: 'the robot stands at the goal',
        Phase.HOLDING: 'the robot stands',
        Phase.FAILED: 'the robot stands, the run is over',
    }
)
EVENT_WORDS: Mapping[Event, str] = MappingProxyType(
    {
        Event.NO_BASELINE: 'no distance to the goal can be seen',
        Event.SIDEWAYS: 'the goal lies beside or behind',
        Event.APART: 'both epipoles can be trusted',
        Event.ALIGNED: 'both epipoles are at the principal point',
        Event.DISPLACED: 'the epipole is where step 1 holds it',
        Event.ESCAPED: 'the epipole of the photograph has left the principal point',
        Event.MATCHED: 'the features are where the photograph has them',
        Event.TURNED: 'the robot does not face as the photograph was taken',
    }
)
_REASONS = {event.value: text for event, text in EVENT_WORDS.items()}
_SAY_WHY = (Phase.WAITING, Phase.HOLDING, Phase.FAILED)  # and that alone: the robot stands


def sentence(phase: Phase, reason: str) -> str:
    """Return in a sentence what the servo does in ``phase``, and the ``reason`` for it, if any."""
    reason = _REASONS.get(reason, reason)
    if phase in _SAY_WHY and reason:
        return f'{phase.value}: {reason}'
    because = f'; {reason}' if reason else ''
    return f'{phase.value}: {PHASE_WORDS[phase]}{because}'
