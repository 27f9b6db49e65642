"""Values: changed copies of frozen ones, for what changes at each step of a loop."""

from typing import Any, TypeVar

ValueT = TypeVar('ValueT')


def changed(value: ValueT, /, **changes: Any) -> ValueT:
    """
    Return a copy of a frozen dataclass with fields changed: ``replace``, several times as fast.

    ``replace`` sets field by field; here they are taken over in one go. The value may have neither
    slots nor a ``__post_init__``, which would not be called.
    """
    copy = object.__new__(type(value))
    before, after = vars(value), vars(copy)
    after.update(before, **changes)
    if len(after) != len(before):
        unknown = ', '.join(sorted(changes.keys() - before.keys()))
        raise TypeError(f'{type(value).__name__} has no field {unknown}; see its definition')
    return copy
