"""
Wide views: how far around its goal a robot drives that may turn wide, but not all the way.

A head that turns its camera, or a lens that sees half a circle, keeps features in view within a
window of headings. From beside the goal, or ahead of it, the aim of delta may ask for a heading
beyond that window. The robot then drives straight on at the window's edge, the distance falls,
and with it |phi|, until the aim is within: delta goes from low + phi to aim(phi), and what is
left of the distance is the ratio of their sines. Where that is too little, or nothing, it backs
off, by the same law driven backward, for which the goal's other side is ahead.
"""

import math

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.smooth.steering import aim, GAINS, PolarPose
from visual_servo_epipolar.core.perception.measurement import Measurement

RESERVE = 0.05  # of the margins of the view [rad]
WIDE_RESERVE = 0.3  # of those by which the way is chosen [rad]
WIDE = 1.0  # of a window of headings to either side, from where on it is wide [rad]
LEAST_SHARE, KEPT_SHARE = 0.35, 0.2  # of the distance left where the aim is seen: at first, later
ASIDE = 0.6  # |phi| and |delta| up to which it is the way ahead as that of any robot [rad]
AT_GOAL = 0.25  # from where the line to it is followed, whatever the direction [m]
IN_PLACE = 1.2  # off the aim of delta, beyond which it does not drive on at all [rad]
STEPS = 12  # of Newton's method; one is exact to a degree


def heading_window(measurement: Measurement, reserve: float) -> tuple[float, float]:
    """Return the least and the largest heading error at which features are in view [rad]."""
    left, right = measurement.view_margins
    if math.isinf(left + right):
        return -math.inf, math.inf
    # About the photograph's heading, whatever features are tracked from here: of a fixed lens
    # these are others from another heading, and a window that moves along leads back and forth.
    half = 0.5 * (left + right) - reserve
    return -half, half


def is_wide(window: tuple[float, float]) -> bool:
    """Return whether a ``window`` of heading errors [rad] is wide to both sides."""
    low, high = window
    return low < -WIDE and high > WIDE and math.isfinite(high - low)


def share_left(phi: float, window: tuple[float, float]) -> float:
    """Return the share of the distance that is left where the aim of delta is within a window."""
    edge = -window[0] if phi > 0.0 else window[1]  # by symmetry of one to the right
    phi = abs(phi)
    if phi - aim(phi) <= edge:
        return 1.0
    if phi >= edge:
        return 0.0  # it leads past the goal
    within = 0.5 * edge
    for _ in range(STEPS):
        slope = 1.0 + GAINS.k1 / (1.0 + (GAINS.k1 * within) ** 2)
        within -= (within - aim(within) - edge) / slope
    return math.sin(edge - phi) / math.sin(edge - within)


def leads_around(
    pose: PolarPose,
    measurement: Measurement,
    settings: DriveSettings,
    *,
    least: float = LEAST_SHARE,
) -> bool:
    """
    Return whether one motion leads from ``pose`` around to the goal, in view all the way.

    A base that steers cannot turn to the aim first: ``on_arcs`` says where its motion leads.
    """
    window = heading_window(measurement, WIDE_RESERVE)
    wide = turns_in_place(settings.drive) and is_wide(window)
    return wide and share_left(pose.phi, window) >= least


def goes_around_in_view(
    pose: PolarPose,
    measurement: Measurement,
    settings: DriveSettings,
    *,
    least: float = KEPT_SHARE,
    aside: float = ASIDE,
) -> bool:
    """Return whether it goes around the goal now: it is ``aside`` [rad] of the way ahead."""
    if pose.distance < AT_GOAL or max(abs(pose.phi), abs(pose.delta)) < aside:
        return False
    return leads_around(pose, measurement, settings, least=least)
