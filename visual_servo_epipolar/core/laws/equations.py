"""
Control laws of the paper and of its departures, one pure function each, in the paper's order.

Epipole abscissae ``e_current`` (e_au) and ``e_desired`` (e_du) and ``focal`` share one unit, which
may be metres, pixels, or one focal length (focal = 1, as in the servo). For an unknown focal
length (section VI, eq. 24) pass the guess f_hat <= f as ``focal``. Gains k1 are in 1/s, k2 in 1/s
times that unit to the power 1 - beta/gamma. Twists are in m/s and rad/s, left positive, and
unlimited: ``motion.saturate`` is a function of its own.
"""

import math

from visual_servo_epipolar.core.geometry.motion import Twist

LINE_DAMPING = 0.9  # ratio of ``follow_line``: an offset falls by exp(-0.9 s / L) over a way s


def signed_power(value: float, exponent: float) -> float:
    """Return value^(beta/gamma) for odd beta and gamma: odd in ``value``."""
    return math.copysign(abs(value) ** exponent, value)


def auxiliary_controls(
    e_current: float,
    e_desired: float,
    *,
    k1: float,
    k2: float,
    exponent: float,
    e_target: float = 0.0,
) -> tuple[float, float]:
    """
    Return (nu_1, nu_2) of eq. (12), the rates asked of the two epipoles, in their unit per second.

    nu_1 = -k1 (e_au - e_target), nu_2 = -k2 e_du^(beta/gamma); the paper has ``e_target`` = 0,
    another one holds e_au away from the singularity.
    """
    return -k1 * (e_current - e_target), -k2 * signed_power(e_desired, exponent)


def finite_time_controls(
    e_current: float, e_desired: float, *, k1: float, k2: float, exponent: float
) -> tuple[float, float]:
    """
    Return (nu_1, nu_2) of eq. (20), the rates that zero both epipoles in finite time.

    nu_1 = -k1 e_au^(beta/gamma), nu_2 = -k2 e_du^(beta/gamma), in the epipoles' unit per second;
    k1 as k2 is in 1/s times that unit to the power 1 - beta/gamma.
    """
    return -k1 * signed_power(e_current, exponent), -k2 * signed_power(e_desired, exponent)


def printed_sigma(e_current: float, e_desired: float) -> float:
    """
    Return sign(e_au e_du), which the paper prints for sigma in (9), (10), (16), (24).

    It differs from sigma = sign cos(psi - theta) in nearly every pose behind the goal that looks
    at the scene. Drive with ``Bearings.sigma``.
    """
    return math.copysign(1.0, e_current * e_desired)


def linearizing_control(
    e_current: float,
    e_desired: float,
    *,
    sigma: float,
    distance: float,
    nu: tuple[float, float],
    focal: float = 1.0,
) -> Twist:
    """
    Return the approximately linearizing feedback of eqs. (11), (16), (17).

    ``sigma`` is the sign of cos(psi - theta), ``distance`` the estimate d_hat [m], ``focal`` the
    focal length or its guess (24), and ``nu`` the auxiliary controls (nu_1, nu_2); ``e_current``
    must not be zero unless nu_2 is.
    """
    nu_1, nu_2 = nu
    squared_current = e_current * e_current + focal * focal
    squared_desired = e_desired * e_desired + focal * focal
    linear = 0.0
    if nu_2 != 0.0:
        # u1 = -sigma d f sqrt(e_au^2 + f^2) / (e_au (e_du^2 + f^2)) nu_2; 1 / sigma = sigma.
        gain = distance * focal * math.sqrt(squared_current) / squared_desired
        linear = -sigma * gain * nu_2 / (e_current or math.copysign(1e-12, sigma))
    angular = focal / squared_current * nu_1 - focal / squared_desired * nu_2
    return Twist(linear, angular)


def epipole_rates(
    twist: Twist,
    e_current: float,
    e_desired: float,
    *,
    sigma: float,
    distance: float,
    focal: float = 1.0,
) -> tuple[float, float]:
    """
    Return the rates of e_au and e_du under ``twist`` (eqs. 9 and 10, with sigma corrected).

    ``distance`` is d [m], ``sigma`` the sign of cos(psi - theta). The rates are in the epipoles'
    unit per second; with h = sqrt(e_au^2 + f^2) they are

        e_au' = -sigma u_1 e_au h / (f d) + u_2 h^2 / f,
        e_du' = -sigma u_1 e_au (e_du^2 + f^2) / (f d h).
    """
    hypotenuse = math.sqrt(e_current * e_current + focal * focal)
    common = twist.linear * sigma / distance * e_current / focal
    return (
        -common * hypotenuse + twist.angular * hypotenuse * hypotenuse / focal,
        -common * (focal * focal + e_desired * e_desired) / hypotenuse,
    )


def distance_rate(linear: float, e_current: float, *, sigma: float, focal: float = 1.0) -> float:
    """
    Return d' = u_1 cos(psi - theta) [m/s] (eq. 18), ``linear`` being u_1 [m/s].

    cos(psi - theta) is sigma f / sqrt(e_au^2 + f^2). Integrated with the applied u_1 it updates
    d_hat; with the unsaturated u_1 of (16) it is eq. (13), or eq. (25) of a guessed focal length.
    """
    return linear * sigma * focal / math.hypot(e_current, focal)


def turn_epipole(e_current: float, e_target: float, *, k1: float) -> Twist:
    """
    Return the turn in place by which e_au goes to ``e_target`` (section IV-B, remarks).

    e_au' = -k1 (e_au - e_target), exponential at the rate k1 [1/s]: with u_1 = 0 and f = 1 in
    (9), u_2 = -k1 (e_au - e_target) / (e_au^2 + 1).
    """
    rate = -k1 * (e_current - e_target)
    return Twist(0.0, 1.0 / (e_current * e_current + 1.0) * rate)


def displaced_epipole(
    e_desired: float, *, ratio: float, low: float, high: float, focal: float = 1.0
) -> float:
    """
    Return the e_au to hold while e_du is zeroed, on the discordant side of ``e_desired``.

    With e_au constant the path is a logarithmic spiral, ln(d_end / d_0) = -|chi_0| / tan(alpha),
    chi_0 = atan(e_du / f), alpha = atan(|e_au| / f). d shrinks if and only if the epipoles are
    discordant, whatever sigma (18), and then the perturbation of (14) pushes e_au away from the
    singularity. ``ratio`` is d_end / d_0, in (0, 1), the part of the distance to keep for the
    second step; ``low`` and ``high`` bound alpha [rad].
    """
    alpha = math.atan(abs(math.atan(e_desired / focal)) / math.log(1.0 / ratio))
    return -math.copysign(focal * math.tan(min(max(alpha, low), high)), e_desired)


def braking_speed(bearing: float, rate: float, *, deceleration: float) -> float:
    """
    Return the largest speed [m/s] from which the robot can stop before ``bearing`` is zero.

    ``bearing`` [rad] changes at ``rate`` [rad/s], and the robot brakes with ``deceleration``
    [m/s^2]. The remaining distance is v tau, tau = |bearing / rate| the time to contact, and
    stopping takes v^2 / (2 a): hence v <= 2 a tau, without knowing any distance. Infinite where
    the bearing does not close in.
    """
    if bearing * rate >= 0.0:
        return math.inf  # not closing in
    return 2.0 * deceleration * abs(bearing / rate)


def match_features(difference: float, *, k_t: float) -> Twist:
    """
    Return the twist of the second step: u_1 = -k_t D, u_2 = 0 (eqs. 21 and 22).

    ``difference`` is D of eq. (23) at unit focal length, ``k_t`` in m/s; or px^2 and m/s/px^2.
    """
    return Twist(-k_t * difference, 0.0)


def follow_line(
    linear: float,
    lateral: float,
    heading_error: float,
    *,
    look_ahead: float,
    least_turn: float = 0.0,
) -> Twist:
    """
    Return the twist of the second step along the y axis: u_1 as given, u_2 steers to the axis.

    Linearised at the axis, x' = -u_1 alpha and alpha' = u_2 give x'' + 1.8 x' / L + x / L^2 = 0
    in the length of the path, of damping ratio 0.9, forward and backward. Replaces u_2 = 0 (eq.
    22), under which the residual offset of the first step and that of unequal wheels remain.

    u_2 = u_1 x / L^2 - 1.8 |u_1| alpha / L, of u_1 ``linear`` [m/s], x ``lateral``, right positive
    [m], alpha left positive [rad] and L ``look_ahead`` [m]. Less than ``least_turn`` [rad] from
    the heading that leads home the robot drives straight on.
    """
    damping = abs(linear) * (2.0 * LINE_DAMPING) * heading_error / look_ahead
    least = abs(linear) * (2.0 * LINE_DAMPING) * least_turn / look_ahead
    turn = linear * lateral / look_ahead**2 - damping
    return Twist(linear, 0.0 if abs(turn) < least else turn)  # nan is refused
