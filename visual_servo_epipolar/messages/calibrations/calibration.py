"""A calibration: what a file says of a camera, with the fields of a CameraInfo."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any, TypeAlias

SIDE, LARGEST = 100_000, 1e9  # of images [px], and of any number in a calibration


@dataclass(frozen=True, kw_only=True)
class Region:
    """The region of interest, all zeros where the image is whole."""

    x_offset: int = 0
    y_offset: int = 0
    width: int = 0
    height: int = 0


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """
    What a file says of a camera, by the names of a CameraInfo.

    Width and height are 0 where it has none, which ``size_keys`` would tell; p is empty likewise.
    """

    width: int
    height: int
    k: tuple[float, ...]
    d: tuple[float, ...] = ()
    distortion_model: str = 'plumb_bob'
    p: tuple[float, ...] = ()
    binning_x: int = 0
    binning_y: int = 0
    roi: Region = Region()
    size_keys: str = 'image_width and image_height'


# The cameras of a document by name, each to be read when it is chosen.
Cameras: TypeAlias = Mapping[str, Callable[[], Calibration]]


def entry(document: Mapping[str, Any], key: str) -> Any:
    """Return what ``document`` has under ``key``, or raise ValueError."""
    if key not in document:
        raise ValueError(f'camera file lacks {key!r}')
    return document[key]


def number(value: Any, key: str) -> float:
    """Return a number, also one that is quoted, or raise ValueError."""
    return _number(value, key, f'{key} must be a number')


def numbers(value: Any, key: str, counts: Sequence[int] = ()) -> tuple[float, ...]:
    """Return numbers of a matrix, (rows of) a list or text, of one of ``counts`` if any."""
    many = f'{" or ".join(map(str, counts))} numbers' if counts else 'numbers'
    expected = f'{key} must be a list of {many}'
    if isinstance(value, Mapping) and 'data' in value:
        value = value['data']
    if isinstance(value, str):
        value = value.split()
    if not isinstance(value, Sequence):
        raise ValueError(f'{expected}, got {as_text(value)}')
    if any(isinstance(row, Sequence) and not isinstance(row, str) for row in value):
        value = _flat(value, expected, is_matrix=bool(counts))
    if counts and len(value) not in counts:
        raise ValueError(f'{expected}, got {len(value)}')
    return tuple(_number(each, key, expected) for each in value)


def whole_number(value: Any, key: str, low: int = 1, high: int = SIDE) -> int:
    """Return a whole number from ``low`` to ``high``, or raise ValueError."""
    expected = f'{key} must be a whole number from {low} to {high}'
    try:
        exact = isinstance(value, int) and not isinstance(value, bool)
        result = int(value) if exact else _number(value, key, expected)
    except ValueError:
        raise ValueError(f'{expected}, got {as_text(value)}') from None
    if not low <= result <= high or result != int(result):
        raise ValueError(f'{expected}, got {as_text(value)}')
    return int(result)


def text(value: Any, key: str) -> str:
    """Return a text, or raise ValueError."""
    if not isinstance(value, str):
        raise ValueError(f'{key} must be a name, got {as_text(value)}')
    return value


def as_text(value: Any) -> str:
    """Return what a user wrote, for messages."""
    if value is None:
        return 'nothing'
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, Mapping):
        return f'the keys {", ".join(map(str, value))}'[:60] if value else 'nothing'
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f'a list of {len(value)}'
    if isinstance(value, int) and abs(value) > LARGEST:
        return 'a number too large'
    return f'{value!r:.40}' if isinstance(value, str) else f'{value!s:.40}'


def _flat(value: Sequence[Any], expected: str, *, is_matrix: bool) -> list[Any]:
    """Return the rows, of one length, one after the other; of a vector there is one, or of one."""
    lengths = {len(row) if isinstance(row, Sequence) else 0 for row in value}
    if len(lengths) > 1 or any(isinstance(row, str) for row in value):
        raise ValueError(f'{expected}, got rows of different lengths')
    if not is_matrix and 1 not in {len(value), *lengths}:
        raise ValueError(f'{expected}, got {len(value)} rows of them')
    return [each for row in value for each in row]


def _number(value: Any, key: str, expected: str) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError
        result = float(value)  # of text too: 1e3 is one in YAML 1.1
    except (OverflowError, ValueError):
        raise ValueError(f'{expected}, got {as_text(value)}') from None
    if not math.isfinite(result) or abs(result) > LARGEST:
        raise ValueError(f'{expected}, finite and below {LARGEST:g}, got {as_text(value)}')
    return result
