"""Names that a command line offers at once: what the servo sees, and regions of starts."""

from collections.abc import Mapping
from types import MappingProxyType

SOURCES = ('features', 'images')
# Least and largest x [m], y [m], heading error [deg].
BOXES: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = (
    MappingProxyType(
        {
            'front': ((-1.5, -5.0, -15.0), (1.5, -2.0, 15.0)),
            'beside': ((-1.5, -2.0, -15.0), (1.5, 1.5, 15.0)),
            'anywhere': ((-6.0, -10.0, -180.0), (6.0, 4.0, 180.0)),
            'around': ((-4.0, -4.0, -180.0), (4.0, 4.0, 180.0)),
        }
    )
)
REGIONS = tuple(BOXES)
IN_VIEW = frozenset({'anywhere', 'around'})  # only poses that have the goal's features in view
WORLDS = ('same', 'light', 'pictures', 'furniture', 'people', 'all', 'dim')  # of repetitions
WAYS = ('short', 'loop', 'rooms', 'ring', 'long')  # through the storey, for routes
