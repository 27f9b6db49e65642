"""How settings are described: one frozen value a component, each field with range and text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, Field, field, fields, replace
from difflib import get_close_matches
import math
import os
from typing import Any, ClassVar, TypeVar

LARGEST = 2**63  # what YAML and ROS parameters hold
ALIKE_FOR_SURE = 0.85  # ratio of difflib above which no other name is meant
MOST, MOST_KNOWN = 3, 20  # names in a message: unknown ones, or meant by one, and known ones
MIN_PART, MIN_PREFIX = 3, 4  # letters that tell a name by a part of it, by its beginning

SettingsT = TypeVar('SettingsT', bound='Settings')


@dataclass(frozen=True, slots=True)
class Range:
    """
    What a setting may be: closed range, choice of words, a path; and whether it may change.

    ``internal``: it is no parameter of a node.
    """

    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False
    path: bool = False
    internal: bool = False


def setting(
    default: Any,
    text: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
    path: bool = False,
    internal: bool = False,
) -> Any:
    """Declare a settings field: default, one line of text with the unit, closed range."""
    limits = Range(text, low, high, choices, read_only, path, internal)
    return field(default=default, metadata={'range': limits})


def fixed(default: Any, text: str, **limits: Any) -> Any:
    """Declare a settings field that cannot change while a node runs; ``limits`` as for others."""
    return setting(default, text, read_only=True, **limits)


def internal(default: Any, text: str, **limits: Any) -> Any:
    """
    Declare a settings field that is no parameter of a node; ``limits`` as for others.

    Scenario files, replay and Python set it: it belongs to an experiment, not to a robot.
    """
    return setting(default, text, internal=True, **limits)


def parameters_of(kind: 'type[Settings] | Settings') -> 'list[Field[Any]]':
    """Return the fields that are parameters of a node."""
    own = [item for item in fields(kind) if item.name not in kind.INTERNAL]
    return [item for item in own if not range_of(item).internal]


def range_of(item: 'Field[Any]') -> Range:
    """Return the range of a settings field."""
    found = item.metadata['range']
    assert isinstance(found, Range)
    return found


@dataclass(frozen=True, kw_only=True)
class Settings:
    """
    Base of every settings value: a value that exists is within its ranges.

    ``RENAMED`` has the names of earlier versions, which files and bags may still use; a kind has
    those of all its bases, too. ``GONE`` has names that mean nothing any more, each with the
    value by which it was off: a file is refused, a bag that was recorded with another is replayed
    with a note. ``INTERNAL`` names inherited fields that are no parameters of this kind.
    """

    INTERNAL: ClassVar[frozenset[str]] = frozenset()
    RENAMED: ClassVar[Mapping[str, str]] = {}
    GONE: ClassVar[Mapping[str, Any]] = {}

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for table in ('RENAMED', 'GONE'):
            bases = (vars(base).get(table, {}) for base in reversed(cls.__mro__))
            setattr(cls, table, dict(item for names in bases for item in names.items()))

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            object.__setattr__(self, item.name, _checked(item.name, value, item))


def selected(kind: type[SettingsT], *parts: Settings) -> SettingsT:
    """Return settings of ``kind`` with what the ``parts`` have of them, the last one first."""
    values = {item.name: getattr(part, item.name) for part in parts for item in fields(part)}
    return kind(**{item.name: values[item.name] for item in fields(kind)})


def names_of(settings: Settings | type[Settings]) -> list[str]:
    """Return the names that ``settings`` have, and had in earlier versions."""
    return [*(item.name for item in fields(settings)), *settings.RENAMED, *settings.GONE]


def updated(settings: SettingsT, values: Mapping[str, Any], where: str) -> SettingsT:
    """
    Return ``settings`` with ``values`` in place, a mapping as read from YAML.

    Raises
    ------
    ValueError
        If a name is unknown, a type is wrong, or a value is out of range; says in ``where``.

    """
    if not isinstance(values, Mapping):
        raise ValueError(f'{where} must map names to values, got {values!r}; write "name: value"')
    values = _renamed(settings.RENAMED, values, where)
    known = [item.name for item in fields(settings)]
    if gone := sorted(settings.GONE.keys() & values.keys()):
        raise ValueError(f'{where} has no setting {", ".join(gone)} any more; leave it out')
    unknown = sorted(set(map(str, values)) - set(known))
    if unknown:
        raise ValueError(f'{where} has no setting {", ".join(unknown)}; {hint(unknown, known)}')
    try:
        return replace(settings, **values)
    except ValueError as error:
        raise ValueError(f'{where}: {error}') from None


def hint(unknown: Sequence[str], known: Sequence[str]) -> str:
    """Return which of the ``known`` names may be meant; some of them if none is alike."""
    meant = list(dict.fromkeys(name for word in unknown[:MOST] for name in alike(word, known)))
    if meant:
        return f'did you mean {" or ".join(meant[:MOST])}?'
    rest = f' and {len(known) - MOST_KNOWN} more' if len(known) > MOST_KNOWN else ''
    return f'it knows {", ".join(known[:MOST_KNOWN])}{rest}'


def alike(word: str, known: Sequence[str]) -> list[str]:
    """Return the names that ``word`` may stand for: misspelt, cut short, or one letter off."""
    word = word.lower().replace('-', '_')
    if word in known:
        return [word]
    close = get_close_matches(word, known, n=1, cutoff=ALIKE_FOR_SURE)
    if not close:
        close = get_close_matches(word, known, n=MOST)
    if not close and len(word) >= MIN_PART:
        close = [name for name in known if word in name or name in word.split('_')]
        close = close or [name for name in known if name.startswith(word[:MIN_PREFIX])]
    if not close and len(word) <= MIN_PART:  # half of a short name may differ
        close = get_close_matches(word, known, n=MOST, cutoff=0.5)
    return close[:MOST]


def _renamed(renamed: Mapping[str, str], values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return ``values`` by today's names; no setting may be given by two names at once."""
    given: dict[str, str] = {}
    for name in values:
        today = renamed.get(name, name)
        if today in given:
            raise ValueError(
                f'{where} must give {today} once, got {given[today]} and {name}, names of one '
                f'setting; keep {today}'
            )
        given[today] = name
    return {today: values[name] for today, name in given.items()}


def _checked(name: str, value: Any, item: 'Field[Any]') -> Any:
    limits, default = range_of(item), item.default
    if isinstance(value, int) and abs(value) > LARGEST:
        raise ValueError(f'{name} must lie in [-2^63, 2^63], got a larger whole number')
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if isinstance(default, tuple) and isinstance(value, list):
        value = tuple(value)
    if isinstance(default, tuple) and isinstance(value, tuple):
        value = _items(name, value, words=bool(default) and isinstance(default[0], str))
    if type(value) is not type(default):
        raise ValueError(
            f'{name} must be {type(default).__name__}, got {value!r} '
            f'({type(value).__name__}); {limits.text}'
        )
    if limits.choices and value not in limits.choices:
        raise ValueError(f'{name} must be one of {", ".join(limits.choices)}, got {value!r}')
    numbers = value if isinstance(value, tuple) else (value,)
    for number in numbers:
        if isinstance(number, (int, float)) and not isinstance(number, bool):
            _check_number(name, float(number), limits)
    return os.path.expanduser(value) if limits.path and isinstance(value, str) else value


def _items(name: str, value: tuple[Any, ...], *, words: bool) -> tuple[Any, ...]:
    """Return the items of a list as numbers, or as words where the default has words."""
    if words:
        if not all(isinstance(item, str) for item in value):
            raise ValueError(f'{name} must be a list of words, got {value!r}')
        return value
    try:
        return tuple(float(number) for number in value)
    except (TypeError, ValueError):
        raise ValueError(f'{name} must be a list of numbers, got {value!r}') from None


def _check_number(name: str, value: float, limits: Range) -> None:
    low = -math.inf if limits.low is None else limits.low
    high = math.inf if limits.high is None else limits.high
    if not (math.isfinite(value) and low <= value <= high):
        raise ValueError(f'{name} must {_bounds(limits)}, got {value:g}; it is: {limits.text}')


def _bounds(limits: Range) -> str:
    """Return the range of a number as words that follow must."""
    if limits.low is None:
        return 'be finite' if limits.high is None else f'be at most {limits.high:g}'
    if limits.high is None:
        return f'be at least {limits.low:g}'
    return f'lie in [{limits.low:g}, {limits.high:g}]'
