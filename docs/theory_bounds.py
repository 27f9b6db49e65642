"""
Theory of the closed loop in both steps: rates, invariants, bounds.

Epipoles and ``focal`` share one unit, as in ``core.laws.equations``; ``guess`` is the
focal length f_hat that the law assumes. With alpha = atan(e_au / f) and chi = atan(e_du / f) the
law obeys, in every sign case and for any gains,

    (ln |sin alpha| d / d_hat)' = -k1 cos^2 alpha,

because d sin(alpha), the distance at which the robot's heading line passes the goal, changes by
turning alone. The bounds on e_au follow from it; docs/theory.md has the proofs.
"""

import math

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.equations import signed_power


def rates_in_bearings(twist: Twist, bearings: Bearings, distance: float) -> tuple[float, float]:
    """
    Return the rates of e_au (eq. 8) and e_du (eq. 7) at unit focal length.

    They need no sign; in epipoles and sigma they are ``equations.epipole_rates``.
    """
    turn = twist.linear * math.sin(bearings.phi) / distance  # -psi', the baseline turning right
    return (
        (turn + twist.angular) / math.cos(bearings.phi) ** 2,
        turn / math.sin(bearings.psi) ** 2,
    )


def closed_loop_rates(
    e_current: float,
    e_desired: float,
    nu: tuple[float, float],
    *,
    ratio: float,
    focal: float = 1.0,
    guess: float | None = None,
) -> tuple[float, float]:
    """
    Return the rates of e_au and e_du under the law: eqs. (14) and (15), (26) and (27).

    Parameters
    ----------
    e_current, e_desired : float
        Epipole abscissae; the rates do not depend on sigma.
    nu : tuple
        Auxiliary controls (nu_1, nu_2) of eq. (12) or (20).
    ratio : float
        d_hat / d.
    focal, guess : float
        f, and f_hat of eq. (24); None for a calibrated camera.

    """
    guess = focal if guess is None else guess
    root, guessed_root = math.hypot(e_current, focal), math.hypot(e_current, guess)
    turn = guess / focal * root * root / (guessed_root * guessed_root) * nu[0]
    drive = guess / focal / (e_desired * e_desired + guess * guess) * nu[1]
    lead = ratio * guessed_root - root
    return (
        turn + drive * root * lead,
        drive * (e_desired * e_desired + focal * focal) * guessed_root / root * ratio,
    )


def distance_scale(e_current: float, *, focal: float, guess: float) -> float:
    """
    Return mu = d' / d_hat' (eq. 29), the ratio of (28) to (25).

    It lies in [1, f / f_hat] for f_hat <= f (eq. 30).
    """
    return focal / guess * math.hypot(e_current, guess) / math.hypot(e_current, focal)


def printed_growth(e_desired: float, least_current: float, *, exponent: float) -> float:
    """
    Return Delta of section IV-C 1 as printed: exp(|e_du,0| / ((1 - beta/gamma) |e_au,min|)).

    It bounds the ratio d_hat / d_hat_0, hence the increment d - d_0 by d_hat_0 (Delta - 1), and
    not by Delta, as the paper says.
    """
    return math.exp(abs(e_desired) / ((1.0 - exponent) * abs(least_current)))


def largest_growth(e_desired: float, least_current: float, *, focal: float = 1.0) -> float:
    """
    Return the bound of d / d_0 in step 1 while |e_au| >= ``least_current``; never above Delta.

    (18) by (10) is (ln d)' = -chi' / tan(alpha): d / d_0 <= exp(f |chi_0| / |e_au,min|), whatever
    the gains, the exponent and d_hat (section IV-C 1, corrected). The inverse bounds its decrease.
    """
    return math.exp(focal * abs(math.atan(e_desired / focal)) / abs(least_current))


def reserve(
    e_current: float,
    distance: float,
    estimate: float,
    *,
    focal: float = 1.0,
    guess: float | None = None,
) -> float:
    """
    Return z = |sin alpha| d / d_hat^(f / f_hat), the quantity that keeps e_au away from zero.

    Distances are in m. Its logarithm falls at the rate k1 f f_hat / (e_au^2 + f_hat^2) at most,
    whatever k2, sigma and the signs of the epipoles (eqs. 14, 18, 19; 26, 28).
    """
    power = 1.0 if guess is None else focal / guess
    sine = abs(e_current) / math.hypot(e_current, focal)
    return float(sine * distance / estimate**power)


def least_sine(
    e_current: float,
    elapsed: float,
    *,
    k1: float,
    ratio: float,
    focal: float = 1.0,
    guess: float | None = None,
) -> float:
    """
    Return a bound below |sin alpha| after ``elapsed`` [s] of step 1: it is never zero.

    |sin alpha| >= |sin alpha_0| exp(-k1 f / f_hat t) / r_0 with r_0 = d_hat_0 / d_0 >= 1 for
    concordant epipoles, for any k2: proposition 1 needs no small k2, and proposition 3 neither.
    Discordant epipoles of a calibrated camera do without 1 / r_0.
    """
    power = 1.0 if guess is None else focal / guess
    sine = abs(e_current) / math.hypot(e_current, focal)
    return sine * math.exp(-k1 * power * elapsed) / ratio


def least_discordant_part(
    ratio: float, *, focal: float = 1.0, guess: float | None = None
) -> float:
    """
    Return what least_sine loses on discordant epipoles: a factor in (0, 1], for ratio > 1.

    A guess f_hat < f makes the perturbation of (26) pull discordant epipoles towards zero too,
    while d_hat / d < f / f_hat; with ratio = d_hat_0 / d_0 of f / f_hat and more it never does.
    """
    power = 1.0 if guess is None else focal / guess
    if ratio >= power:
        return 1.0
    growth = (ratio - 1.0) / (power - 1.0)  # d / d_0 where the factor is least
    return float((1.0 - (1.0 - growth) / ratio) ** power / growth) if growth > 0.0 else 0.0


def largest_finite_time_gain(
    e_current: float, e_desired: float, *, k2: float, exponent: float, ratio: float = 1.0
) -> float:
    """
    Return the bound of k1 with which (20) zeroes e_du before e_au.

    The paper has k2 |e_au,0 / e_du,0|^(1 - beta/gamma), which is right for d_hat = d alone. In
    general e_au is to be replaced by |sin alpha_0| / r_0, r_0 = d_hat_0 / d_0, at f = 1.
    """
    numerator = abs(e_current)
    if ratio > 1.0:
        numerator /= math.hypot(numerator, 1.0) * ratio
    return k2 * abs(signed_power(numerator / e_desired, 1.0 - exponent))


def stays_finite(e_current: float, e_desired: float, *, focal: float = 1.0) -> bool:
    """
    Return whether discordant epipoles keep e_au finite for every k1, k2 and d_hat_0 >= d_0.

    |alpha| + |chi| is then the heading error, and by (17) it only falls: 90 deg are enough, and as
    d_hat / d grows they are needed. Beyond, e_au may pass through infinity (section IV-C 2).
    """
    return abs(math.atan(e_current / focal)) + abs(math.atan(e_desired / focal)) <= 0.5 * math.pi


def matching_slope(offset: float, depth: float, behind: float, *, focal: float = 1.0) -> float:
    """
    Return alpha = -D / d~ of eq. (23), positive while the feature is ahead of both cameras.

    Parameters
    ----------
    offset : float
        Distance sqrt(X^2 + Y^2) of the feature from the desired optical axis [m].
    depth : float
        Its depth Z from the goal [m].
    behind : float
        d~ [m]: how far the robot is behind the goal, negative ahead of it.
    focal : float
        Focal length; D is in its unit squared.

    """
    now = depth + behind
    return focal * focal * offset * offset * (depth + now) / (depth * depth * now * now)
