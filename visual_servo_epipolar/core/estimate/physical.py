"""
Physical bounds: what a base on wheels can be at most, whatever its motion seems to teach.

Two more are where their layers are: the focal ratio (``geometry.lens.MOST_RATIO``), and the mount
of the camera, which is the configured one, and its deviations (``extrinsics.PLAUSIBLE``).
"""

MOST_CURVATURE = 0.3  # of wheels that shall roll straight on: unequal by a tenth [rad/m]
MOST_DELAY_S = 1.5  # from an image to the motion that it causes [s]
MOST_TURN_RATIO = 1.6  # of a turn over that commanded
# Way by the wheels over that commanded: no base drives farther, and many drive less.
FASTER, SLOWER = 1.25, 0.5
# What any base follows [m/s, rad/s], or a larger part of the largest velocity.
FOLLOWED, FOLLOWED_PART = 0.065, 0.2


def largest_dead_band(limit: float) -> float:
    """Return what any base follows whose largest velocity is ``limit`` [m/s, rad/s]."""
    return min(max(FOLLOWED, FOLLOWED_PART * limit), limit)
