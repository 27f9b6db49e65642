"""
Selection between a planar and a general motion, and what is left of the deviation of the first.

By minimum description length: the planar motion has a parameter less, which is worth log(N) of
the robust cost (Torr's GRIC weighs costs the same way). Costs are at the scale of the residuals,
less what their tails add: by shares of inliers, each attitude that bends far enough would do.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Attitude, Estimate
from visual_servo_epipolar.core.estimators.general.deviation import Spread
from visual_servo_epipolar.core.estimators.general.motion import cost_of_essential, GeneralFit
from visual_servo_epipolar.core.estimators.machinery.attitude_prior import JITTER_DEVIATIONS
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays


def planar_is_simplest(
    planar: Estimate, fit: GeneralFit, spread: Spread, rays: Rays, mount: Attitude
) -> bool:
    """Return whether a ``planar`` motion explains the matches as well as the best general one."""
    excess = (
        cost_of_essential(planar.fundamental, fit, rays) - float(fit.costs[0])
    ) / spread.tails
    excess += (planar.jump / (JITTER_DEVIATIONS * mount.jitter)) ** 2 if mount.jitter else 0.0
    if planar.attitude is not None:
        excess += ((planar.attitude.tilt - mount.tilt) / mount.tilt_deviation) ** 2
        excess += ((planar.attitude.roll - mount.roll) / mount.roll_deviation) ** 2
    return excess <= math.log(rays.matches)


def planar_deviations(planar: Estimate, spread: Spread) -> FloatArray:
    """
    Return the deviations of a planar motion, (3,) [rad]: current, desired, heading.

    A level plane is as far from that of motion as tilt and roll are unknown: to second order that
    turns bearings between the axis and across it.
    """
    covariance = planar.whole_covariance
    psi, phi = covariance[0, 0], covariance[1, 1]
    variances = np.array([phi, psi, max(psi + phi - 2.0 * covariance[0, 1], 0.0)]) * spread.tails
    variances += spread.camera**2
    if planar.attitude is not None:
        lean = planar.attitude.tilt_deviation**2 + planar.attitude.roll_deviation**2
        bearings = np.array([planar.bearings.current, planar.bearings.desired])
        variances[:2] += (0.5 * lean * np.sin(2.0 * bearings)) ** 2
    return np.asarray(np.sqrt(variances))
