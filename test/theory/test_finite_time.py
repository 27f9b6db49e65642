"""Eq. (20): both epipoles in finite time, and the condition on k1, as printed and corrected."""

import math

from drives import drive, Law, Start
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats
import theory_bounds as theory

from visual_servo_epipolar.core.laws import equations

SIGNS = st.sampled_from([-1.0, 1.0])
EXPONENTS = st.sampled_from([1.0 / 3.0, 5.0 / 9.0, 7.0 / 9.0])
RUNS = settings(max_examples=30)


def time_of(e_current: float, law: Law) -> float:
    """Return when |e_au|' = -k1 |e_au|^(beta/gamma) is zero [s]."""
    rest = 1.0 - law.exponent
    return abs(e_current) ** rest / (law.k1 * rest)


@given(floats(-3.0, 3.0), floats(-3.0, 3.0), EXPONENTS)
def test_20_has_the_odd_power_of_both(e_au: float, e_du: float, exponent: float) -> None:
    found = equations.finite_time_controls(e_au, e_du, k1=0.1, k2=0.5, exponent=exponent)
    expected = [-k * math.copysign(abs(e) ** exponent, e) for k, e in ((0.1, e_au), (0.5, e_du))]
    assert found == pytest.approx(expected)


@RUNS
@given(floats(0.3, 0.8), floats(0.05, 0.6), SIGNS, SIGNS, SIGNS, EXPONENTS, floats(0.1, 0.8))
def test_at_the_true_distance_it_is_right(e_au, e_du, side, other, sigma, exponent, part) -> None:
    k2 = 0.5
    most = theory.largest_finite_time_gain(e_au, e_du, k2=k2, exponent=exponent)
    assert most == pytest.approx(k2 * (e_au / e_du) ** (1.0 - exponent))
    law = Law(k1=part * most, k2=k2, exponent=exponent, finite=True)
    run = drive(Start(e_current=side * e_au, e_desired=other * e_du, sigma=sigma), law)
    assert run.ended == 'zeroed'
    # |e_au|^(1-b) falls in a straight line; its zero is what is left to wait for.
    rest = 1.0 - exponent
    expected = e_au**rest - law.k1 * rest * run.times
    np.testing.assert_allclose(np.abs(run.e_current) ** rest, expected, atol=1e-6)
    assert run.times[-1] < time_of(e_au, law)


@RUNS
@given(floats(0.3, 0.8), floats(0.05, 0.6), SIGNS, SIGNS, EXPONENTS, floats(1.0, 6.0))
def test_if_overestimated_the_corrected_is_enough(
    e_au: float, e_du: float, side: float, sigma: float, exponent: float, ratio: float
) -> None:
    k2, rest = 0.5, 1.0 - exponent
    most = theory.largest_finite_time_gain(e_au, e_du, k2=k2, exponent=exponent, ratio=ratio)
    sine = math.sin(math.atan(e_au)) / ratio if ratio > 1.0 else e_au
    assert most == pytest.approx(k2 * (sine / e_du) ** rest)
    law = Law(k1=0.5 * most, k2=k2, exponent=exponent, finite=True)
    start = Start(e_current=side * e_au, e_desired=side * e_du, sigma=sigma, ratio=ratio)
    run = drive(start, law)
    assert run.ended == 'zeroed'
    # z = |sin alpha| d / d_hat: z^(1-b) falls no faster than in a straight line.
    z = np.abs(np.sin(run.alpha)) * run.distance / run.estimate
    least = z[0] ** rest - law.k1 * rest * run.times
    assert (z**rest >= least - 1e-6).all()
    # From there on e_au is alone: a finite time in all.
    total = run.times[-1] + time_of(float(run.e_current[-1]), law)
    assert total <= time_of(e_au, law) * (1.0 + 1e-6)


def test_with_an_overestimate_the_printed_bound_is_not_enough() -> None:
    k2, exponent = 0.5, 1.0 / 3.0
    e_au, e_du = math.tan(0.15), math.tan(0.6)
    printed = theory.largest_finite_time_gain(e_au, e_du, k2=k2, exponent=exponent)
    law = Law(k1=0.9 * printed, k2=k2, exponent=exponent, finite=True)
    run = drive(Start(e_current=e_au, e_desired=e_du, ratio=3.0), law, duration=1.34)
    # e_au is zero before e_du (at 1.347 s): the law is singular, and the robot leaves for good.
    assert abs(run.e_current[-1]) < 1e-2
    assert abs(run.e_desired[-1]) > 0.1
    assert run.distance[-1] > 1e6
    right = drive(Start(e_current=e_au, e_desired=e_du), law)
    assert right.ended == 'zeroed'
