"""Parcels: messages on their way, and what of the world is in them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True, slots=True)
class Sight:
    """Sight: when an image was taken [ns, steady], and whether it shows what was there then."""

    taken_ns: int
    true: bool = True

    def lie(self) -> 'Sight':
        """Return what shows something else than was there."""
        return replace(self, true=False)


@dataclass(slots=True)
class Parcel:
    """
    A message on ``topic``, under way for ``delay_ns``, made from what was seen as ``sight``.

    ``sender`` is the node that published it, '' while that is being made.
    """

    topic: str
    message: Any
    delay_ns: int
    sight: Sight | None = None
    sender: str = ''

    def changed(self, **changes: Any) -> 'Parcel':
        """Return another parcel that differs in these."""
        return replace(self, **changes)


# What a fault does to the messages of a topic: each becomes none, one or many.
Filter = Callable[[Parcel], Iterable[Parcel]]
