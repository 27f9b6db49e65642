"""
Words of laws that messages, files and plots share: names, phases with their flags, events.

What a phase does stands in its row (``machine.PhaseRow``), and how phases follow each other in the
machine of a law (``machine.StateMachine``). A law may define phases and events of its own.
"""

from dataclasses import astuple, dataclass
from typing import Any, ClassVar

from visual_servo_epipolar.core.registry import Registry

LAW_GROUP = 'visual_servo_epipolar.laws'
OWN_LAWS = ('paper', 'corrected', 'full', 'smooth')

# The word for a servo that was started, and drives as soon as it can: the phase is WAITING.
ARMED = 'armed'


def law_names() -> list[str]:
    """Return the names of all laws, our own first, without loading any."""
    return list(Registry(LAW_GROUP, dict.fromkeys(OWN_LAWS)))


@dataclass(frozen=True, eq=False)
class Phase:
    """
    Phase of the servo: one object for each word, ``value``, compared by ``is``.

    ``drives``: the base moves. ``ended``: the run is over. ``turns_in_place``: it turns to the
    heading of the photograph, no more. ``backs_off``: it drives away from the goal.
    ``closes_in``: the distance to the goal hardly grows, so that the limits of way and excursion
    hold. ``straight``: it drives straight at the goal, so that D shows its slope.
    """

    value: str
    drives: bool = False
    ended: bool = False
    turns_in_place: bool = False
    backs_off: bool = False
    closes_in: bool = False
    straight: bool = False

    known: ClassVar[dict[str, 'Phase']] = {}  # by word, those of laws in use at the end
    WAITING: ClassVar['Phase']
    ORIENTING: ClassVar['Phase']
    RETREATING: ClassVar['Phase']
    DISPLACING: ClassVar['Phase']
    ZEROING_EPIPOLES: ClassVar['Phase']
    MATCHING_FEATURES: ClassVar['Phase']
    ARRIVED: ClassVar['Phase']
    HOLDING: ClassVar['Phase']
    FAILED: ClassVar['Phase']

    def __post_init__(self) -> None:
        if self.value in self.known:
            raise ValueError(f'phase {self.value!r} is defined already; choose another word')
        self.known[self.value] = self

    @property
    def runs(self) -> bool:
        """Whether a run goes on in it."""
        return self.drives or self is Phase.HOLDING

    def __reduce__(self) -> tuple[Any, ...]:
        return _same, (Phase, *astuple(self))


def unarmed(word: str) -> str:
    """Return the phase that a word on ``phase`` or in diagnostics is of: an armed servo waits."""
    return Phase.WAITING.value if word == ARMED else word


def _same(kind: Any, value: str, *facts: Any) -> Any:
    """Return the phase or event of this word in a process that may not have its law in use."""
    return kind.known.get(value) or kind(value, *facts)


Phase.WAITING = Phase('waiting')
Phase.ORIENTING = Phase('orienting', drives=True, turns_in_place=True)
Phase.RETREATING = Phase('retreating', drives=True, backs_off=True)
Phase.DISPLACING = Phase('displacing', drives=True)
Phase.ZEROING_EPIPOLES = Phase('zeroing_epipoles', drives=True, closes_in=True)
Phase.MATCHING_FEATURES = Phase('matching_features', drives=True, closes_in=True, straight=True)
Phase.ARRIVED = Phase('arrived', ended=True)
Phase.HOLDING = Phase('holding')
Phase.FAILED = Phase('failed', ended=True)


@dataclass(frozen=True, eq=False)
class Event:
    """
    Event: what one measurement means to the state machine, in a word, ``value``.

    ``sentence`` gives it as the reason of a change of phase, '' where the servo has a longer one.
    ``fails``: it ends any run.
    """

    value: str
    sentence: str = ''
    fails: bool = False

    known: ClassVar[dict[str, 'Event']] = {}
    NOTHING: ClassVar['Event']
    AMBIGUOUS: ClassVar['Event']
    AMBIGUOUS_NEAR: ClassVar['Event']
    RESOLVED: ClassVar['Event']
    NO_BASELINE: ClassVar['Event']
    SIDEWAYS: ClassVar['Event']
    APART: ClassVar['Event']
    ALIGNED: ClassVar['Event']
    DISPLACED: ClassVar['Event']
    ESCAPED: ClassVar['Event']
    MATCHED: ClassVar['Event']
    TURNED: ClassVar['Event']
    MISSED: ClassVar['Event']
    LOST: ClassVar['Event']
    EXHAUSTED: ClassVar['Event']
    NO_GAIN: ClassVar['Event']
    DIVERGED: ClassVar['Event']
    DISOBEYED: ClassVar['Event']
    EXCURSION: ClassVar['Event']
    TIMED_OUT: ClassVar['Event']

    def __post_init__(self) -> None:
        self.known[self.value] = self

    def __reduce__(self) -> tuple[Any, ...]:
        return _same, (Event, *astuple(self))


Event.NOTHING = Event('nothing')
Event.AMBIGUOUS = Event(
    'ambiguous', 'two geometries fit a plane, and the goal is ahead by both: motion tells'
)
Event.AMBIGUOUS_NEAR = Event(
    'ambiguous near', 'two geometries fit a plane near the goal: motion tells'
)
Event.RESOLVED = Event('resolved', 'one of two geometries is left')
Event.NO_BASELINE = Event('no baseline', 'no distance to the goal can be seen')
Event.SIDEWAYS = Event('sideways', 'the goal lies beside or behind')
Event.APART = Event('apart', 'both epipoles can be trusted')
Event.ALIGNED = Event('aligned', 'both epipoles are at the principal point')
Event.DISPLACED = Event('displaced', 'the epipole is where step 1 holds it')
Event.ESCAPED = Event('escaped', 'the epipole of the photograph has left the principal point')
Event.MATCHED = Event('matched', 'the features are where the photograph has them')
Event.TURNED = Event('turned', 'the robot does not face as the photograph was taken')
Event.MISSED = Event('missed')  # at the end of step 2, but not at the goal
Event.LOST = Event('lost')  # too few features, or a geometry that cannot be trusted
Event.EXHAUSTED = Event('exhausted', fails=True)  # missed, and no attempt is left
Event.NO_GAIN = Event('no gain')  # none is legal from here (section IV-C)
Event.DIVERGED = Event('diverged', fails=True)  # an epipole ran away
# Too often for the run to go on.
Event.DISOBEYED = Event('the base contradicts its commands', fails=True)
Event.EXCURSION = Event('excursion', fails=True)  # farther from the goal than the phase may lead
Event.TIMED_OUT = Event('timed out', fails=True)
