"""Transition table of the step-switching state machine, with its phases and events."""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType


class Phase(str, Enum):
    """Phase of the servo; the words appear in messages, files and plots."""

    WAITING = 'waiting'
    ORIENTING = 'orienting'
    RETREATING = 'retreating'
    DISPLACING = 'displacing'
    ZEROING_EPIPOLES = 'zeroing_epipoles'
    MATCHING_FEATURES = 'matching_features'
    ARRIVED = 'arrived'
    HOLDING = 'holding'
    FAILED = 'failed'


class Event(str, Enum):
    """Event: what one measurement means to the state machine."""

    NOTHING = 'nothing'
    NO_BASELINE = 'no baseline'  # pure rotation, or too close for the epipoles
    SIDEWAYS = 'sideways'  # the goal is beside or behind: turn and back off first
    APART = 'apart'  # a baseline, and epipoles that can be trusted
    ALIGNED = 'aligned'  # both epipoles at the principal point
    DISPLACED = 'displaced'  # the current epipole is at the target of step 1
    ESCAPED = 'escaped'  # the desired epipole left zero again
    MATCHED = 'matched'  # the features are where the photograph has them
    TURNED = 'turned'  # at the goal, but not facing as the photograph was taken
    MISSED = 'missed'  # at the end of step 2, but not at the goal
    LOST = 'lost'  # too few features, or a geometry that cannot be trusted
    EXHAUSTED = 'exhausted'  # missed, and no attempt is left
    NO_GAIN = 'no gain'  # none is legal from here (section IV-C)
    DIVERGED = 'diverged'  # an epipole ran away
    DISOBEYED = 'the base contradicts its commands'  # too often for the run to go on
    ASTRAY = 'astray'  # farther from the goal than the phase may lead
    TIMED_OUT = 'timed out'
    STOPPED = 'stopped'


DRIVING = (
    Phase.ORIENTING,
    Phase.RETREATING,
    Phase.DISPLACING,
    Phase.ZEROING_EPIPOLES,
    Phase.MATCHING_FEATURES,
)
# The word for who was told to start, and drives as soon as it can: the phase is WAITING.
ARMED = 'armed'
RUNNING = (*DRIVING, Phase.HOLDING)  # a run goes on
ENDED = (Phase.ARRIVED, Phase.FAILED)

# From a survey of the situation: at the start, and after tracks came back.
_SURVEY = {
    Event.NO_BASELINE: Phase.ORIENTING,
    Event.SIDEWAYS: Phase.RETREATING,
    Event.APART: Phase.DISPLACING,
    Event.ALIGNED: Phase.MATCHING_FEATURES,
    Event.MATCHED: Phase.ARRIVED,
}

TRANSITIONS: Mapping[tuple[Phase, Event], Phase] = MappingProxyType(
    {
        **{(Phase.WAITING, event): phase for event, phase in _SURVEY.items()},
        **{(Phase.HOLDING, event): phase for event, phase in _SURVEY.items()},
        (Phase.WAITING, Event.LOST): Phase.HOLDING,
        (Phase.ORIENTING, Event.APART): Phase.DISPLACING,
        (Phase.ORIENTING, Event.SIDEWAYS): Phase.RETREATING,
        (Phase.ORIENTING, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.ORIENTING, Event.MATCHED): Phase.ARRIVED,
        (Phase.RETREATING, Event.APART): Phase.DISPLACING,
        (Phase.RETREATING, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.DISPLACING, Event.DISPLACED): Phase.ZEROING_EPIPOLES,
        (Phase.ZEROING_EPIPOLES, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.ZEROING_EPIPOLES, Event.SIDEWAYS): Phase.RETREATING,
        (Phase.ZEROING_EPIPOLES, Event.ESCAPED): Phase.DISPLACING,
        (Phase.ZEROING_EPIPOLES, Event.NO_BASELINE): Phase.ORIENTING,
        (Phase.ZEROING_EPIPOLES, Event.NO_GAIN): Phase.DISPLACING,
        (Phase.DISPLACING, Event.NO_GAIN): Phase.FAILED,
        (Phase.MATCHING_FEATURES, Event.NO_GAIN): Phase.FAILED,
        (Phase.MATCHING_FEATURES, Event.MATCHED): Phase.ARRIVED,
        (Phase.MATCHING_FEATURES, Event.TURNED): Phase.ORIENTING,
        (Phase.MATCHING_FEATURES, Event.MISSED): Phase.RETREATING,
        **{(phase, Event.LOST): Phase.HOLDING for phase in DRIVING},
        **{
            (phase, event): Phase.FAILED
            for phase in RUNNING
            for event in (
                Event.TIMED_OUT,
                Event.DIVERGED,
                Event.EXHAUSTED,
                Event.DISOBEYED,
                Event.ASTRAY,
            )
        },
        **{(phase, Event.STOPPED): Phase.WAITING for phase in Phase},
    }
)


def next_phase(phase: Phase, event: Event) -> Phase:
    """Return the phase that follows ``event``; a pair not in the table keeps the phase."""
    return TRANSITIONS.get((phase, event), phase)
