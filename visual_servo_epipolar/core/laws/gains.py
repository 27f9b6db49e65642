"""
Gains of both steps, derived from section IV-C before the robot moves.

In continuous time the law works for any gains (docs/theory.md, 2.1); sampling, delay and limits of
speed are what bounds them. Saturation by one common factor costs time and leaves the path, so that
limits of speed enter only where a command is held for one period. docs/theory.md, 3, has the
reasons, test/core/laws/test_gains.py the runs.

Settling times are those within the limits of speed: t_max of section IV-C is a bound for a robot
without. Concordant epipoles make it back away, up to exp(|chi_0| / tan|alpha|) times as far as it
was, and a slow base spends its time there.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.laws.circumstances import Circumstances

CRITICAL_GAIN_DELAY = 1.0 / math.e  # gain times delay at which an integrator is critically damped
RATIOS = 9  # values of d_hat_0 / d_0, of which one gives the longest path
STEPS = 100  # of the integration over e_du, or over the distance
LAST_DISTANCE = 1e-3  # distance at which step 2 is at the goal [m]


@dataclass(frozen=True, slots=True)
class Gains:
    """
    Gains of eqs. (12) and (21) at unit focal length, with the bounds that hold for them.

    Step 1, eq. (12): ``k1`` [1/s], ``k2`` [1/s], and ``beta``, ``gamma``, odd, of the exponent
    beta / gamma. ``k1_alone`` [1/s] may replace k1 once e_du is zero, or where e_au is held.
    Step 2, eq. (21): ``k_t`` [m/s], and ``rate`` [1/s], at which k_t closes in at the goal.
    Bounds: ``transient`` [s], the longest time to zero e_du at speeds without limit, and
    ``floor`` [rad], the bearing that e_au keeps until then.
    """

    k1: float
    k2: float
    beta: int
    gamma: int
    k_t: float
    k1_alone: float
    transient: float
    floor: float
    rate: float

    @property
    def exponent(self) -> float:
        """The exponent beta / gamma of (12)."""
        return self.beta / self.gamma


def derive(circumstances: Circumstances) -> Gains:
    """
    Return the gains for the ``circumstances`` of a start (section IV-C).

    Raises ValueError if concordant epipoles begin too close to the singularity for any gain, or
    one period is too long for the limits of speed.
    """
    beta, gamma = quickest_exponent(circumstances)
    exponent = beta / gamma
    k2 = convergence_gain(circumstances, exponent=exponent)
    transient = longest_transient(math.tan(circumstances.desired), k2=k2, exponent=exponent)
    k1_alone = CRITICAL_GAIN_DELAY / circumstances.period
    decay = largest_decay(circumstances)
    floor = least_bearing(circumstances)
    if not circumstances.concordant:
        floor = math.atan(math.tan(circumstances.current) * math.exp(-decay))
    return Gains(
        k1=min(decay / transient, k1_alone),
        k2=k2,
        beta=beta,
        gamma=gamma,
        k_t=matching_gain(circumstances),
        k1_alone=k1_alone,
        transient=transient,
        floor=floor,
        rate=closing_rate(circumstances),
    )


def longest_transient(
    e_desired: float, *, k2: float, exponent: float, shrink: float = 1.0
) -> float:
    """
    Return t_max [s], by which e_du is zero (section IV-C 1): that of d_hat = d, the slowest.

    With b the exponent, t_max = |e_du(0)|^(1 - b) / (k2 (1 - b)). ``e_desired`` is e_du(0) at unit
    focal length, ``k2`` in 1/s. ``shrink`` is f_hat / f, 1 for a calibrated camera: with a guess
    d_hat / d may fall to f_hat / f while the robot backs away, and (27) to its third power.
    """
    complement = 1.0 - exponent
    return float(abs(e_desired) ** complement / (k2 * complement * shrink**3))


def quickest_exponent(circumstances: Circumstances) -> tuple[int, int]:
    """
    Return the odd beta, gamma that zero e_du soonest under sampling (section IV-C 1, revised).

    With k2 of ``convergence_gain``, t_max is (e_0 / e_landing)^(1 - b) / (1 - b) periods: least
    where 1 - b = 1 / ln(e_0 / e_landing). The paper has b near 0 to bound the increment of d,
    which does not depend on b (docs/theory.md, 2.3).
    """
    log_span = math.log(math.tan(circumstances.desired) / math.tan(circumstances.landing))
    gamma = max(3, 2 * round((2.0 * log_span - 1.0) / 2.0) + 1)  # odd, and 1 - b = 2 / gamma
    return gamma - 2, gamma


def largest_ratio(circumstances: Circumstances) -> float:
    """
    Return an upper bound of d_hat / d in step 1 (from eqs. 17 and 19).

    It falls while concordant epipoles move apart from the goal. For discordant ones it is
    |sin alpha| over the reserve, where alpha grows to |alpha_0| + |chi_0| at most.
    """
    if circumstances.concordant:
        return circumstances.ratio
    alpha, chi = circumstances.current, circumstances.desired
    sine_growth = math.sin(alpha + chi) / math.sin(alpha)
    return circumstances.ratio * math.e * sine_growth


def convergence_gain(circumstances: Circumstances, *, exponent: float) -> float:
    """Return k2 [1/s]: in one period (15) takes e_du from the landing to zero, never past it."""
    landing = math.tan(circumstances.landing)
    ratio = largest_ratio(circumstances)
    return float(landing ** (1.0 - exponent) / (ratio * circumstances.period))


def least_bearing(circumstances: Circumstances) -> float:
    """
    Return the floor alpha_m of |atan e_au| [rad]: twice the turn of e_au in one period T.

    By u_2 and by u_1 sin(alpha) / d: alpha_m = 2 w_max T / (1 - v_max T / d). A command held for
    one period then never carries e_au past zero.
    """
    period, distance = circumstances.period, circumstances.nearest
    linear, angular = circumstances.max_linear, circumstances.max_angular
    approach = linear * period / distance
    turn = 2.0 * angular * period
    if approach >= 0.5 or turn / (1.0 - approach) >= 0.5 * math.pi:
        raise ValueError(
            f'one period must be short for the limits, got {period:g} s at '
            f'{linear:g} m/s and {angular:g} rad/s from {distance:g} m; '
            'lower max_linear or max_angular, or raise rate or nearest'
        )
    return turn / (1.0 - approach)


def largest_decay(circumstances: Circumstances) -> float:
    """
    Return the bound of k1 t_max in step 1: the inequality of section IV-C 2 for concordant signs.

    e_au stays beyond the floor alpha_m while e_du is zeroed if k1 t_max is at most

        ln(sin|alpha_0| / (r_0 sin alpha_m))    from the reserve, r_0 = d_hat_0 / d_0, or
        ln(|alpha_0| / (alpha_m + (1 - 1/r_0) |chi_0|))    from (14) and (15) for any r_0;

    so k1 must be small *against* k2, and k2 large, not small. Discordant epipoles are pushed
    outwards and need no bound; e_au keeps 1/e of where it began, lest the robot come too near.
    Raises ValueError if both are negative: no gain is legal.
    """
    if not circumstances.concordant:
        return 1.0
    alpha, ratio = circumstances.current, circumstances.ratio
    floor = least_bearing(circumstances)
    by_reserve = ratio * math.sin(floor)
    by_lead = floor + (1.0 - 1.0 / ratio) * circumstances.desired
    decay = max(math.log(math.sin(alpha) / by_reserve), math.log(alpha / by_lead))
    if decay <= 0.0:
        least = min(by_lead, math.asin(by_reserve) if by_reserve < 1.0 else math.inf)
        raise ValueError(
            f'concordant epipoles need |atan e_au| above {least:.3g} rad with d_hat_0 / d_0 up to '
            f'{ratio:.3g}, got {alpha:.3g}; turn first, best to the other sign'
        )
    return decay


def closing_rate(circumstances: Circumstances) -> float:
    """
    Return the rate of step 2 [1/s]: critically damped under the delay, and within the brakes.

    At the speed max_linear a rate asks for the deceleration rate * max_linear.
    """
    damped = CRITICAL_GAIN_DELAY / circumstances.period
    return min(damped, circumstances.deceleration / circumstances.max_linear)


def matching_gain(circumstances: Circumstances) -> float:
    """
    Return k_t of (21) [m/s], D at unit focal length, from the depth Z of the scene [m].

    Near the goal (23) is D = -(2 mean|p_d|^2 / Z) d~ at most, d~ the signed distance [m], so that
    the rate of step 2 is k_t 2 mean|p_d|^2 / Z.
    """
    return closing_rate(circumstances) * circumstances.depth / (2.0 * circumstances.spread)


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
