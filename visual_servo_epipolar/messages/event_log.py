"""
Event log: what happened to a node between two images, as JSON on ``~/events``.

Images and settings alone do not show that ``~/stop`` was called; a replay needs it.
"""

from dataclasses import asdict, dataclass
import json

# Of the servo, beside its interruptions, and of the tracker.
STARTED, CAPTURED, REDETECTED = 'started', 'captured', 'redetected'


@dataclass(frozen=True, slots=True)
class Entry:
    """Event after the image of ``after_stamp_ns``; None means before the first image."""

    event: str
    after_stamp_ns: int | None = None
    reason: str = ''


def to_text(entry: Entry) -> str:
    """Return an entry as JSON."""
    return json.dumps(asdict(entry))


def from_text(text: str) -> Entry:
    """Return what ``to_text`` wrote; raises ValueError for any other text."""
    try:
        document = json.loads(text)
        after_ns = document['after_stamp_ns']
        after_ns = None if after_ns is None else int(after_ns)
        return Entry(str(document['event']), after_ns, str(document['reason']))
    except (LookupError, OverflowError, RecursionError, TypeError, ValueError):
        raise ValueError(
            f'an event must be JSON with event, after_stamp_ns and reason, got {text!r:.80}; '
            'connect ~/events of a node'
        ) from None
