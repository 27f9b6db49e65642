"""A law of one's own: what another package brings to visual_servo_epipolar."""

from dataclasses import replace
import math

from visual_servo_epipolar.core.laws.registry import LAWS

WIDTH = 0.5  # of e_du, at unit focal length, where the control levels off


def bounded_controls(e_current, e_desired, *, k1, k2, exponent, e_target=0.0):
    """Return (nu_1, nu_2) as eq. (12), with tanh for the power: bounded far from the axis."""
    return -k1 * (e_current - e_target), -k2 * math.tanh(e_desired / WIDTH)


BOUNDED = replace(LAWS['full'], epipole_controls=bounded_controls)
