"""
How long step 1 takes at most with speeds as limited as they are, and how far it leads.

t_max of section IV-C is a bound for a robot without limits. Concordant epipoles make it back away,
up to exp(|chi_0| / tan|alpha|) times as far as it was, and a slow base spends its time there.
"""

import math

import numpy as np

from visual_servo_epipolar.core.control.gains import Circumstances, Gains

RATIOS, STEPS = 9, 100  # of d_hat_0 / d_0 and of e_du, to find the longest way


def longest_landing(known: Circumstances, found: Gains) -> float:
    """
    Return the longest time until e_du is zero [s], with speeds as limited as they are.

    One common factor max(1, |u_1| / v, |u_2| / w) stretches the time of the bare law, so that it
    takes t_max + way / v + turn / w at most. Of the turn, (17) has |chi_0| from nu_2 and
    k1 |sin alpha cos alpha| a second from nu_1.
    """
    way = known.farthest * (1.0 + known.desired)  # |dd| + d |dchi| while d falls
    if known.concordant:
        way = longest_way(known, found)
    turn = known.desired + 0.5 * found.k1 * found.transient
    return found.transient + way / known.max_linear + turn / known.max_angular + known.period


def longest_way(known: Circumstances, found: Gains) -> float:
    """
    Return the way of step 1 from concordant epipoles [m]; it leads away from the goal.

    Integrates (14), (15), (18) at f = 1 from the worst start, by the midpoint rule. A smaller
    |e_au| or a larger |e_du| makes it longer, d_hat_0 / d_0 may do either: the longest of some
    ratios is returned. Saturation by one common factor does not change it.
    """
    ratios = np.geomspace(1.0, known.ratio, RATIOS)
    rest = 1.0 - found.exponent
    powers = np.linspace(
        math.tan(known.desired) ** rest, math.tan(known.landing) ** rest, STEPS + 1
    )  # linear in time
    bearings = np.arctan(powers ** (1.0 / rest))
    wait = -np.diff(powers) / (found.k2 * rest)
    growth = np.zeros(RATIOS)  # ln d / d_0
    kept = np.log(math.sin(known.current) / ratios)  # ln of the reserve
    way = np.zeros(RATIOS)
    for turn, time in zip(-np.diff(bearings), wait, strict=True):
        middle = [growth, kept]
        for part in (0.5, 1.0):
            lead = 1.0 + (ratios - 1.0) * np.exp(-middle[0])  # d_hat / d
            sine = lead * np.exp(middle[1])
            cosine = np.sqrt(1.0 - sine * sine)
            middle = [
                growth + part * turn * cosine / sine,
                kept - part * found.k1 * time / lead * cosine**2,
            ]
        way += turn * np.exp(0.5 * (growth + middle[0])) / sine
        growth, kept = middle
    return known.farthest * float(np.max(way / ratios))
