"""Motion between two views of a run: it needs no photograph, no scale and no distance."""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.geometry.rotation import fit_rotation

COMMON, COMMON_SHARE = 8, 0.4  # features that two views must have in common, of the first one's
NOISE_OF_PARALLAX = 1.2  # of two views of one place, in deviations of a coordinate
LEAST_NOISE = 1e-9  # [rad]
STANDING_TURN, STANDING_PARALLAX = 0.015, 2.5  # of who stands at most [rad], [deviations]
TURN_DEVIATIONS = 6.0  # that a turn between two views may be wrong by, of a parallax


class Reference(NamedTuple):
    """View at ``stamp_ns``: ``ids``, (N,), and unit rays, (N, 3), of its features."""

    stamp_ns: int
    ids: IntArray
    rays: FloatArray


class ViewMotion(NamedTuple):
    """Motion between two views: ``turn``, left positive, ``parallax`` and its ``noise`` [rad]."""

    turn: float
    parallax: float
    noise: float

    @property
    def stands(self) -> bool:
        """Whether nothing moved."""
        within = abs(self.turn) < STANDING_TURN + TURN_DEVIATIONS * self.noise
        return within and self.parallax < STANDING_PARALLAX * self.noise


def view_motion(reference: Reference, here: Reference, noise: float) -> ViewMotion | None:
    """Return the motion between two views; None where they cannot tell."""
    if here.stamp_ns <= reference.stamp_ns:
        return None
    _, now, before = np.intersect1d(
        here.ids, reference.ids, assume_unique=True, return_indices=True
    )
    # What is left of many may be those that are wrong.
    if len(now) < max(COMMON, COMMON_SHARE * len(reference.ids)):
        return None
    fit = fit_rotation(here.rays[now], reference.rays[before])
    return ViewMotion(fit.heading_error, fit.parallax, max(NOISE_OF_PARALLAX * noise, LEAST_NOISE))
