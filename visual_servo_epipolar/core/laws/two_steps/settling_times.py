"""
Settling times of both steps within the limits of speed, and the path that step 1 drives.

t_max of section IV-C is a bound for a robot without limits. Concordant epipoles make it back away,
up to exp(|chi_0| / tan|alpha|) times as far as it was, and a slow base spends its time there.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.laws.two_steps.gains import Circumstances, Gains

RATIOS = 9  # values of d_hat_0 / d_0, of which one gives the longest path
STEPS = 100  # of the integration over e_du, or over the distance
LAST_DISTANCE = 1e-3  # distance at which step 2 is at the goal [m]


def longest_convergence(circumstances: Circumstances, gains: Gains) -> float:
    """
    Return the longest time until e_du is zero [s], within the limits of speed.

    One common factor max(1, |u_1| / v_max, |u_2| / w_max) stretches the time of the bare law, so
    that e_du lands within t_max + path / v_max + turn / w_max. Of the turn, (17) has |chi_0| from
    nu_2 and k1 |sin alpha cos alpha| a second from nu_1.
    """
    path = circumstances.farthest * (1.0 + circumstances.desired)  # |dd| + d |dchi| while d falls
    if circumstances.concordant:
        path = longest_path(circumstances, gains)
    turn = circumstances.desired + 0.5 * gains.k1 * gains.transient
    return (
        gains.transient
        + path / circumstances.max_linear
        + turn / circumstances.max_angular
        + circumstances.period
    )


def longest_matching(circumstances: Circumstances, gains: Gains) -> float:
    """
    Return the longest time of step 2 [s], from where step 1 may have left the robot.

    Integrates (21), D = mean|p_d|^2 (1 - (Z / (Z + d))^2) at the depth Z of the nearest features,
    at no more than max_linear.
    """
    distance = circumstances.farthest
    if circumstances.concordant:
        distance += longest_path(circumstances, gains)
    distances = np.geomspace(LAST_DISTANCE, distance, STEPS + 1)
    ratio = circumstances.depth / (circumstances.depth + distances)
    speeds = np.minimum(
        gains.k_t * circumstances.spread * (1.0 - ratio**2), circumstances.max_linear
    )
    # Trapezoids over ln d: v is proportional to d near the goal.
    pace = distances / speeds
    duration = float(np.sum(0.5 * (pace[1:] + pace[:-1]) * np.diff(np.log(distances))))
    return duration + circumstances.period


def longest_path(circumstances: Circumstances, gains: Gains) -> float:
    """
    Return the longest path of step 1 from concordant epipoles [m]; it leads away from the goal.

    Integrates (14), (15), (18) at f = 1 from the worst start, by the midpoint rule. A smaller
    |e_au| or a larger |e_du| makes it longer, d_hat_0 / d_0 may do either: the longest over RATIOS
    values of it is returned. Saturation by one common factor does not change the path.
    """
    ratios = np.geomspace(1.0, circumstances.ratio, RATIOS)
    turns, durations = _grid(circumstances, gains)
    log_distance = np.zeros(RATIOS)  # ln d / d_0
    log_reserve = np.log(math.sin(circumstances.current) / ratios)  # ln |sin alpha| d / d_hat
    path = np.zeros(RATIOS)  # over d_0
    for turn, decay in zip(turns, gains.k1 * durations, strict=True):
        middle = [log_distance, log_reserve]
        for part in (0.5, 1.0):
            lead = 1.0 + (ratios - 1.0) * np.exp(-middle[0])  # d_hat / d
            sine = lead * np.exp(middle[1])
            cosine = np.sqrt(1.0 - sine * sine)
            middle = [
                log_distance + part * turn * cosine / sine,
                log_reserve - part * decay / lead * cosine**2,
            ]
        path += turn * np.exp(0.5 * (log_distance + middle[0])) / sine
        log_distance, log_reserve = middle
    return circumstances.farthest * float(np.max(path / ratios))


def _grid(circumstances: Circumstances, gains: Gains) -> tuple[FloatArray, FloatArray]:
    """Return the turn of chi [rad] and the duration [s] of each step to zero, shape (STEPS,)."""
    complement = 1.0 - gains.exponent
    first, last = math.tan(circumstances.desired), math.tan(circumstances.landing)
    powers = np.linspace(first**complement, last**complement, STEPS + 1)  # linear in time
    bearings = np.arctan(powers ** (1.0 / complement))
    return -np.diff(bearings), -np.diff(powers) / (gains.k2 * complement)
