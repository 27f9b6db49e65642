"""Names that a command line offers at once: what the servo sees, and regions of starts."""

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

from visual_servo_epipolar.core.errors import InputError

SOURCES = ('features', 'images')


class StartRegion(NamedTuple):
    """
    Region of starts: a ``box`` of least and largest x [m], y [m] and heading error [deg].

    ``in_view``: of poses alone that have the goal's features in view.
    """

    box: tuple[tuple[float, float, float], tuple[float, float, float]]
    in_view: bool = False


REGIONS: Mapping[str, StartRegion] = MappingProxyType(
    {
        'front': StartRegion(((-1.5, -5.0, -15.0), (1.5, -2.0, 15.0))),
        'beside': StartRegion(((-1.5, -2.0, -15.0), (1.5, 1.5, 15.0))),
        'anywhere': StartRegion(((-6.0, -10.0, -180.0), (6.0, 4.0, 180.0)), in_view=True),
        'around': StartRegion(((-4.0, -4.0, -180.0), (4.0, 4.0, 180.0)), in_view=True),
    }
)
WORLDS = ('same', 'all')  # of repetitions
WAYS = ('short', 'loop', 'rooms', 'ring', 'long')  # through the storey, for routes


def refuse_unknown(name: str, value: str, known: Collection[str]) -> None:
    """Raise InputError if ``value`` is none of the ``known`` ones, which ``name`` must be."""
    if value not in known:
        raise InputError(f'{name} must be one of {", ".join(known)}, got {value!r}')
