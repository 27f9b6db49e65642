"""The few errors this package raises; bad input is a ValueError as everywhere in Python."""

from collections.abc import Sequence

SHOWN = 6  # names in a message


class VisualServoError(Exception):
    """Base of every error that is neither a programming mistake nor a bad value."""


class DegenerateGeometryError(VisualServoError):
    """Two views cannot answer: the baseline is too short, or the scene lies on one plane."""


class TrackingError(VisualServoError):
    """The desired view cannot be found in the current image."""


class InputError(VisualServoError):
    """A file or an argument given by the user cannot be used; ends a command with exit code 2."""


def listed(names: Sequence[str]) -> str:
    """Return names in the words of a message: the first ones, and how many more there are."""
    more = f' and {len(names) - SHOWN} more' if len(names) > SHOWN else ''
    return ', '.join(map(str, names[:SHOWN])) + more or 'none'
