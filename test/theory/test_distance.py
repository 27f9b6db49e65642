"""Section IV-C 1: how far the robot may back away in step 1, as printed and corrected."""

import math

from drives import drive, Law, Start
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats
import theory_bounds as theory

SIGNS = st.sampled_from([-1.0, 1.0])
EXPONENTS = st.sampled_from([1.0 / 9.0, 5.0 / 9.0, 7.0 / 9.0])
LAWS = st.builds(Law, k1=floats(0.01, 0.15), k2=floats(0.3, 3.0), exponent=EXPONENTS)


@settings(max_examples=60)
@given(floats(0.2, 1.2), floats(0.05, 1.0), SIGNS, SIGNS, floats(1.0, 6.0), LAWS)
def test_both_bounds_hold_as_ratios_ours_is_tighter(e_au, e_du, side, sigma, ratio, law) -> None:
    start = Start(
        e_current=side * e_au, e_desired=side * e_du, sigma=sigma, distance=3.0, ratio=ratio
    )
    run = drive(start, law)
    assert run.ended == 'zeroed'
    least = float(np.abs(run.e_current).min())
    growth = run.distance.max() / start.distance
    ours = theory.largest_growth(e_du, least)
    printed = theory.printed_growth(e_du, least, exponent=law.exponent)
    assert growth <= ours * (1.0 + 1e-7)
    assert ours <= printed
    # What the printed one bounds, and what follows for the increment of d.
    assert run.estimate.max() / run.estimate[0] <= printed * (1.0 + 1e-7)
    increment = run.distance.max() - start.distance
    assert increment <= run.estimate[0] * (printed - 1.0) * (1.0 + 1e-7)


@settings(max_examples=30)
@given(floats(0.3, 1.2), floats(0.05, 0.4), SIGNS, SIGNS, floats(1.0, 6.0), LAWS)
def test_a_discordant_start_keeps_beyond_the_inverse(e_au, e_du, side, sigma, ratio, law) -> None:
    start = Start(e_current=side * e_au, e_desired=-side * e_du, sigma=sigma, ratio=ratio)
    run = drive(start, law)
    least = float(np.abs(run.e_current).min())
    assert run.distance.min() * theory.largest_growth(e_du, least) >= 1.0 - 1e-7


def test_the_increment_is_not_bounded_by_delta_as_printed() -> None:
    # Metres cannot be bounded by a number without unit: 10 m away, d grows by 4 m, Delta is 2.1.
    start = Start(e_current=1.0, e_desired=0.5, distance=10.0)
    law = Law(k1=0.05, k2=2.0, exponent=1.0 / 9.0)
    run = drive(start, law)
    least = float(np.abs(run.e_current).min())
    increment = run.distance.max() - start.distance
    assert increment > 1.9 * theory.printed_growth(0.5, least, exponent=law.exponent)


@settings(max_examples=15)
@given(floats(0.3, 1.2), floats(0.05, 1.0), SIGNS, floats(1.0, 4.0))
def test_the_exponent_matters_only_through_k1(e_au, e_du, side, ratio) -> None:
    # The paper: beta/gamma "should be chosen close to zero in order to reduce Delta". The path
    # does not know it: with k1 = 0, d_end / d_0 is the same for all.
    start = Start(e_current=side * e_au, e_desired=side * e_du, ratio=ratio)
    ends = [
        drive(start, Law(k1=0.0, k2=1.0, exponent=exponent)).distance[-1]
        for exponent in (1.0 / 9.0, 5.0 / 9.0, 7.0 / 9.0)
    ]
    assert ends == pytest.approx([ends[0]] * 3, rel=1e-5)


@settings(max_examples=15)
@given(floats(0.3, 1.2), floats(0.1, 1.0), SIGNS)
def test_with_k1_0_and_the_true_distance_the_path_is_a_log_spiral(e_au, e_du, other) -> None:
    run = drive(Start(e_current=e_au, e_desired=other * e_du), Law(k1=0.0, k2=1.0))
    turned = math.atan(e_du) - np.abs(np.arctan(run.e_desired))
    np.testing.assert_allclose(np.log(run.distance), other * turned / e_au, atol=1e-6)
    assert np.log(run.distance[-1]) == pytest.approx(
        other * math.log(theory.largest_growth(e_du, e_au)), rel=1e-2
    )
