"""Eqs. (16) to (20) along integrated runs: step 1 in finite time, and the bounds of its way."""

import math

from drives import drive, Law, RESIDUE, Start
from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, pose_with
import theory_bounds as theory

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.gains import longest_transient

SIGNS = st.sampled_from([-1.0, 1.0])
RATIOS = st.one_of(st.just(1.0), floats(1.0, 4.0))
EXPONENTS = st.sampled_from([1.0 / 3.0, 5.0 / 9.0, 7.0 / 9.0])
RUNS = settings(max_examples=40)


@st.composite
def starts(draw: st.DrawFn, *, concordant: bool | None = None) -> Start:
    """Draw a start of either kind whose heading error keeps e_au finite (|alpha| + |chi|)."""
    alpha = draw(floats(0.35, 0.8))
    chi = draw(floats(0.05, min(0.7, 1.5 - alpha)))
    side, other = draw(SIGNS), draw(SIGNS)
    if concordant is not None:
        other = side if concordant else -side
    return Start(
        e_current=side * math.tan(alpha),
        e_desired=other * math.tan(chi),
        sigma=draw(SIGNS),
        distance=draw(floats(0.5, 8.0)),
        ratio=draw(RATIOS),
        ahead=draw(st.booleans()),
    )


def gains(*, k2_low: float = 0.3) -> st.SearchStrategy[Law]:
    return st.builds(Law, k1=floats(0.02, 0.1), k2=floats(k2_low, 3.0), exponent=EXPONENTS)


@RUNS
@given(starts(), gains())
def test_19_the_estimate_keeps_its_lead(start: Start, law: Law) -> None:
    run = drive(start, law)
    lead = (start.ratio - 1.0) * start.distance
    ratio = run.estimate / run.distance
    # The tolerance is the solver's, over a distance that grows.
    np.testing.assert_allclose(ratio, 1.0 + lead / run.distance, rtol=1e-7)
    assert (ratio >= 1.0 - 1e-7).all()


@RUNS
@given(starts(), gains())
def test_the_desired_epipole_is_zero_before_the_longest_transient(start: Start, law: Law) -> None:
    run = drive(start, law)
    latest = longest_transient(start.e_desired, k2=law.k2, exponent=law.exponent)
    assert run.ended == 'zeroed'
    assert run.times[-1] <= latest * (1.0 + 1e-9)
    assert (np.diff(np.abs(run.e_desired)) < 0.0).all()
    # With d_hat = d the bound is the time itself, less what is left of e_du.
    if start.ratio == 1.0:
        spare = longest_transient(RESIDUE, k2=law.k2, exponent=law.exponent)
        assert run.times[-1] == pytest.approx(latest - spare, rel=1e-6)


@RUNS
@given(starts(concordant=True), gains(k2_low=0.3), floats(1.0, 50.0), floats(1.0, 20.0))
def test_no_gain_makes_the_current_epipole_cross_zero(start, law, faster, ratio) -> None:
    # Proposition 1 asks for a small k2; the reserve shows that any will do, even far from small.
    law = Law(k1=law.k1, k2=faster * law.k2, exponent=law.exponent)
    start = Start(**{**vars(start), 'ratio': ratio})
    run = drive(start, law)
    assert run.ended == 'zeroed'
    sine = np.abs(np.sin(run.alpha))
    terms = {'k1': law.k1, 'ratio': start.ratio}
    least = [theory.least_sine(start.e_current, t, **terms) for t in run.times]
    assert (sine >= np.array(least) * (1.0 - 1e-6)).all()
    assert (run.e_current * start.e_current > 0.0).all()


def test_it_is_a_small_k2_that_sends_the_robot_away() -> None:
    start = Start(e_current=0.4, e_desired=0.4, ratio=1.5)
    runs = [drive(start, Law(k1=0.3, k2=k2)) for k2 in (0.06, 3.0)]
    far, near = (run.distance.max() / start.distance for run in runs)
    assert near < 4.0
    assert far > 1e3 * near


@RUNS
@given(starts(concordant=False), gains())
def test_discordant_epipoles_bring_the_goal_nearer_and_the_heading_error_falls(start, law) -> None:
    assert theory.stays_finite(start.e_current, start.e_desired)
    run = drive(start, law)
    bearings = np.abs(np.arctan(run.e_current)) + np.abs(np.arctan(run.e_desired))
    assert (np.diff(bearings) < 0.0).all()
    assert (np.diff(run.distance) < 0.0).all()
    # The perturbation pushes outwards: e_au is never below its own decay at k1.
    decay = np.abs(start.e_current) * np.exp(-law.k1 * run.times)
    assert (np.abs(run.e_current) >= decay * (1.0 - 1e-7)).all()


def test_beyond_90_degrees_a_discordant_start_may_end_with_its_back_to_the_goal() -> None:
    # The paper: "any value of k2 is legal" and "the epipoles never change sign".
    start = Start(e_current=math.tan(1.2), e_desired=-math.tan(1.0), ratio=10.0)
    law = Law(k1=0.05, k2=1.0)
    assert not theory.stays_finite(start.e_current, start.e_desired)
    run = drive(start, law)
    assert run.ended == 'infinite'
    # From beyond infinity the law goes on, and does zero both epipoles, facing the wrong way.
    first, last = final_pose(start, law), final_pose(Start(**{**vars(start), 'ratio': 1.0}), law)
    for pose in (first, last):
        seen = Bearings.from_pose(pose)
        assert abs(seen.epipole_desired) < 1e-3
        assert abs(seen.epipole_current) < 1e-3
    turned = math.remainder(first.heading_error - last.heading_error, 2.0 * math.pi)
    assert abs(turned) == pytest.approx(math.pi, abs=5e-3)


def final_pose(start: Start, law: Law) -> Pose:
    """Return where small steps of the law end, e_du latched at the residue."""
    pose, estimate, dt, latched = start.pose, start.ratio * start.distance, 1e-3, False
    for i in range(200_000):
        seen = Bearings.from_pose(pose)
        latched = latched or abs(seen.epipole_desired) < 1e-4
        twist = law.twist(seen, estimate)
        if latched:
            dt, k1 = 1e-2, 1.0  # only a turn is left: hurry
            twist = equations.turn_epipole(seen.epipole_current, 0.0, k1=k1)
            if abs(seen.epipole_current) < 1e-4 and i > 100:
                break
        e_current = seen.epipole_current
        estimate += dt * equations.distance_rate(twist.linear, e_current, sigma=seen.sigma)
        pose = integrate(pose, twist, dt)
    return pose


@given(floats(-1.2, 1.2), SIGNS, floats(0.3, 6.0), floats(-1.0, 1.0))
def test_the_zero_dynamics_is_the_way_along_the_axis(e_au, sigma, distance, speed) -> None:
    # With e_du zero, (16) is zero and so is d': the law turns in place.
    nu = equations.auxiliary_controls(e_au, 0.0, k1=0.3, k2=0.5, exponent=5.0 / 9.0)
    twist = equations.linearizing_control(e_au, 0.0, sigma=sigma, distance=9.0, nu=nu)
    assert twist.linear == 0.0
    assert equations.distance_rate(twist.linear, e_au, sigma=sigma) == 0.0
    # With both zero no speed moves them, which is what the second step lives on.
    pose = pose_with(0.0, 0.0, sigma=sigma, distance=distance)
    assume(abs(speed) < 0.9 * distance)
    rates = equations.epipole_rates(Twist(speed, 0.0), 0.0, 0.0, sigma=sigma, distance=distance)
    assert rates == (0.0, 0.0)
    moved = Bearings.from_pose(integrate(pose, Twist(speed, 0.0), 1.0))
    assert moved.epipole_current == pytest.approx(0.0, abs=1e-12)
    assert moved.epipole_desired == pytest.approx(0.0, abs=1e-12)


@RUNS
@given(starts(), gains(), floats(0.1, 10.0))
def test_one_common_factor_on_both_speeds_leaves_the_path(start, law, factor) -> None:
    # (4), (13) and the law hold no time: saturation by one factor costs time alone.
    run = drive(start, law)
    scaled = Law(k1=factor * law.k1, k2=factor * law.k2, exponent=law.exponent)
    other = drive(start, scaled)
    assert other.times[-1] == pytest.approx(run.times[-1] / factor, rel=1e-6)
    np.testing.assert_allclose(other.states[:4], run.states[:4], rtol=1e-5, atol=1e-6)


LAWS = st.builds(Law, k1=floats(0.01, 0.15), k2=floats(0.3, 3.0), exponent=EXPONENTS)


@settings(max_examples=60)
@given(floats(0.2, 1.2), floats(0.05, 1.0), SIGNS, SIGNS, floats(1.0, 6.0), LAWS)
def test_both_bounds_hold_as_ratios_ours_is_tighter(e_au, e_du, side, sigma, ratio, law) -> None:
    place = {'sigma': sigma, 'distance': 3.0, 'ratio': ratio}
    start = Start(e_current=side * e_au, e_desired=side * e_du, **place)
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
