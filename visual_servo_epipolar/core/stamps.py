"""Stamps in whole nanoseconds, as messages have them, and the seconds between two."""

NANOSECONDS = 1_000_000_000
KEPT_S = 3.0  # of what is known by stamps: no image is older, and no delay longer
AHEAD_S = 0.1  # by which an image may be newer than a reading or a pose: they go on as they did
MOST_GAP_S = 1.0  # between two images or messages, over which a motion is followed
OTHER_CLOCK_S = 60.0  # a difference that no delay explains: two clocks
NOT_ADVANCING = 'the stamps do not advance; is /clock published?'


def period_ns(frame_rate: float) -> int:
    """Return the time between two frames [ns]: whole, so that stamps add up exactly."""
    return round(NANOSECONDS / frame_rate)


def seconds_between(earlier_ns: int, later_ns: int) -> float:
    """Return the time between two stamps [s]."""
    return (later_ns - earlier_ns) / NANOSECONDS
