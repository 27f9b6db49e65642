"""Small cameras, as keyword arguments of their settings."""


def sized(width: int, height: int, focal_length: float, u: float, v: float) -> dict[str, float]:
    """Return the settings of a pinhole camera with its principal point at (u, v) [px]."""
    size = {'width': width, 'height': height}
    return {**size, 'focal_length': focal_length, 'principal_u': u, 'principal_v': v}


SMALL = sized(320, 240, 192.0, 159.5, 119.5)
TINY = sized(160, 128, 96.0, 79.0, 63.0)
MINUTE = sized(64, 48, 40.0, 31.25, 23.5)
