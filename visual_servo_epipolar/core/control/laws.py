"""
The control laws of the paper, one pure function each, in the paper's order.

Epipole abscissae ``e_current`` (e_au) and ``e_desired`` (e_du) and ``focal`` share one unit, which
may be metres, pixels, or one focal length (focal = 1, as the servo has it). An unknown focal
length (section VI, eq. 24) is the same law with the guess f_hat <= f passed as ``focal``.
Velocities come out unlimited: ``motion.saturate`` is a function of its own.
"""

import math

from visual_servo_epipolar.core.geometry.motion import Twist


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
    """Return (nu_1, nu_2) of eq. (12); ``e_target`` holds e_au away from zero meanwhile."""
    return -k1 * (e_current - e_target), -k2 * signed_power(e_desired, exponent)


def finite_time_controls(
    e_current: float, e_desired: float, *, k1: float, k2: float, exponent: float
) -> tuple[float, float]:
    """Return (nu_1, nu_2) of eq. (20), which zeroes both epipoles in finite time."""
    return -k1 * signed_power(e_current, exponent), -k2 * signed_power(e_desired, exponent)


def printed_sigma(e_current: float, e_desired: float) -> float:
    """
    Return sign(e_au e_du), as the paper prints it in (9), (10), (16), (24).

    It stands there for sigma = sign cos(psi - theta), but differs from it in nearly every pose
    behind the goal that looks at the scene. Drive with ``Bearings.sigma``.
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

    Parameters
    ----------
    e_current, e_desired : float
        Epipole abscissae; ``e_current`` must not be zero unless nu_2 is.
    sigma : float
        Sign of cos(psi - theta).
    distance : float
        Estimate d_hat of the distance to the goal [m].
    nu : tuple
        Auxiliary controls (nu_1, nu_2): wanted rates of the two epipoles.
    focal : float
        Focal length, or its guess (eq. 24), in the unit of the epipoles.

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
    """Return the rates of e_au and e_du under ``twist`` (eqs. 9 and 10, with sigma corrected)."""
    root = math.sqrt(e_current * e_current + focal * focal)
    pull = twist.linear * sigma / distance * e_current / focal
    return (
        -pull * root + twist.angular * root * root / focal,
        -pull * (focal * focal + e_desired * e_desired) / root,
    )


def distance_rate(linear: float, e_current: float, *, sigma: float, focal: float = 1.0) -> float:
    """
    Return d' = u_1 cos(psi - theta) [m/s] (eq. 18), which updates d_hat by the applied speed.

    With the unsaturated u_1 of (16) this is eq. (13), and eq. (25) for a guessed focal length.
    """
    return linear * sigma * focal / math.hypot(e_current, focal)


def turn_epipole(e_current: float, e_target: float, *, k1: float, focal: float = 1.0) -> Twist:
    """Turn in place until e_au = e_target, exponentially at rate k1 (section IV-B, remarks)."""
    rate = -k1 * (e_current - e_target)
    return Twist(0.0, focal / (e_current * e_current + focal * focal) * rate)


def displaced_epipole(
    e_desired: float, *, ratio: float, low: float, high: float, focal: float = 1.0
) -> float:
    """
    Return where to hold e_au while e_du is zeroed, on the discordant side of ``e_desired``.

    With e_au constant the path is a logarithmic spiral, ln(d_end / d_0) = -|chi_0| / tan(alpha),
    chi_0 = atan(e_du / f), alpha = atan(|e_au| / f). d shrinks if and only if the epipoles are
    discordant, whatever sigma (18), and then the perturbation of (14) pushes e_au away from the
    singularity.

    Parameters
    ----------
    e_desired : float
        Desired epipole.
    ratio : float
        Part of the distance to keep for the second step, d_end / d_0 in (0, 1).
    low, high : float
        Bounds of alpha [rad]; the upper one is what the field of view leaves.
    focal : float
        Focal length in the unit of the epipoles.

    """
    alpha = math.atan(abs(math.atan(e_desired / focal)) / math.log(1.0 / ratio))
    return -math.copysign(focal * math.tan(min(max(alpha, low), high)), e_desired)


def braking_speed(bearing: float, rate: float, *, deceleration: float) -> float:
    """
    Return the largest speed [m/s] from which the robot can stop before ``bearing`` is zero.

    What is left to go is v tau, tau = bearing / rate the time to contact, and stopping takes
    v^2 / (2 a): hence v <= 2 a tau, without knowing any distance.
    """
    if bearing * rate >= 0.0:
        return math.inf  # not closing in
    return 2.0 * deceleration * abs(bearing / rate)


def match_features(difference: float, *, k_t: float) -> Twist:
    """Return the second step: u_1 = -k_t D, u_2 = 0 (eqs. 21 and 22)."""
    return Twist(-k_t * difference, 0.0)


def adaptive_gain(size: float, *, at_zero: float, far: float, slope: float) -> float:
    """
    Return the gain for an error of ``size``: ``at_zero`` at zero, ``far`` for a large one.

    (k_0 - k_inf) exp(-k'_0 |e| / (k_0 - k_inf)) + k_inf with the slope k'_0 at zero, as
    vpAdaptiveGain of ViSP has it: gentle where limits of speed and braking count, brisk where the
    error is nearly gone and a constant gain would take its time.
    """
    span = at_zero - far
    if span == 0.0:
        return far
    return span * math.exp(-slope * abs(size) / abs(span)) + far


def follow_line(
    linear: float, lateral: float, heading_error: float, *, look_ahead: float
) -> Twist:
    """
    Return the second step on the y axis: u_1 as given, u_2 steers back onto the line.

    Linearised at the axis, x' = -u_1 alpha and alpha' = u_2 give x'' + 1.8 x' / L + x / L^2 = 0
    in the length of the way, damped by 0.9, forward and backward. Replaces u_2 = 0 (eq. 22),
    which leaves what the first step left and what unequal wheels add.

    Parameters
    ----------
    linear : float
        u_1 [m/s].
    lateral : float
        Offset x from the axis, right positive [m].
    heading_error : float
        alpha, left positive [rad].
    look_ahead : float
        L [m].

    """
    damping = abs(linear) * 1.8 * heading_error / look_ahead
    return Twist(linear, linear * lateral / look_ahead**2 - damping)


def turn_to_heading(heading_error: float, *, gain: float) -> Twist:
    """Turn in place until the heading of the desired view is reached: a proportional rotation."""
    return Twist(0.0, -gain * heading_error)
