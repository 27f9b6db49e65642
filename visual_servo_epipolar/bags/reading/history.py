"""History of a run: what was ordered and which settings were changed on the way, in order."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from visual_servo_epipolar.bags.reading.run import Recording
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import event_log
from visual_servo_epipolar.messages.event_log import Entry
from visual_servo_epipolar.messages.settings_text import NodeSettings

WORDS = {
    'halted': 'brought to a standstill',
    'lost': 'held, for no tracks came that it may drive by',
    'timed out': 'failed, for no such tracks came while it held',
    'reset': 'reset to a new run, by ~/reset or ~/start, or as the node was deactivated',
    'stopped': 'stopped, by ~/stop or the stop button, or as the node was deactivated or ended',
    event_log.STARTED: 'started, by ~/start',
    event_log.REDETECTED: 'all features matched anew, by ~/redetect',
    event_log.CAPTURED: 'photograph taken, by ~/capture_desired',
}


@dataclass(frozen=True, slots=True)
class Happening:
    """What happened to a node, ``time_s`` after the first image [s]; None: before any image."""

    time_s: float | None
    node: str
    what: str
    reason: str = ''


def happenings(run: Recording, first_ns: int) -> list[Happening]:
    """Return events and changes of settings in the order of time; ``first_ns`` is time 0."""
    stamped = [
        *_events('servo', run.servo_events),
        *_events('tracker', run.tracker_events),
        *_changes('servo', run.servo),
        *_changes('tracker', run.tracker),
        *_photographs(run),
    ]
    stamped.sort(key=lambda item: -1 if item[0] is None else item[0])  # those of one time as above
    return [
        Happening(None if stamp is None else seconds_between(first_ns, stamp), *words)
        for stamp, words in stamped
    ]


Stamped = tuple[int | None, tuple[str, str, str]]  # stamp [ns]; node, what, reason


def _events(node: str, entries: Sequence[Entry]) -> Iterator[Stamped]:
    for item in entries:
        yield item.after_stamp_ns, (node, WORDS.get(item.event, item.event), item.reason)


def _changes(node: str, history: Sequence[tuple[int | None, NodeSettings]]) -> Iterator[Stamped]:
    for (_, before), (stamp_ns, after) in zip(history, history[1:], strict=False):
        for name, value in after.values.items():
            old = before.values.get(name)
            if old != value:
                yield stamp_ns, (node, f'{name} set from {_as_text(old)} to {_as_text(value)}', '')


def _photographs(run: Recording) -> Iterator[Stamped]:
    """Yield the photographs after the first; ~/capture_desired tells of its own ones."""
    taken = {
        item.after_stamp_ns for item in run.tracker_events if item.event == event_log.CAPTURED
    }
    for stamp_ns, _ in run.photographs[1:]:
        if stamp_ns not in taken:
            yield stamp_ns, ('tracker', 'another photograph', '')


def _as_text(value: Any) -> str:
    return 'nothing' if value is None else str(value)
