"""Eqs. (14) to (19) along integrated runs, zero dynamics, and proposition 1 beyond its proof."""

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
def test_14_15_and_18_hold_along_a_run(start: Start, law: Law) -> None:
    run = drive(start, law)
    x, y, theta, estimate, _ = run.states
    d = run.distance
    x_rate, y_rate, theta_rate = run.rates()[:3]
    # Derivatives of (5), (6) and d by the chain rule from the unicycle's rates alone.
    psi_rate = (x * y_rate - y * x_rate) / d**2
    desired_rate = (x_rate * y - x * y_rate) / y**2
    current_rate = (1.0 + run.e_current**2) * (theta_rate - psi_rate)
    distance_rate = (x * x_rate + y * y_rate) / d
    for i in range(len(run.times)):
        a, e = float(run.e_current[i]), float(run.e_desired[i])
        expected = theory.closed_loop_rates(a, e, law.nu(a, e), ratio=estimate[i] / d[i])
        # d_hat / d times the push cancels in (14) where it is 1.
        found = float(current_rate[i]), float(desired_rate[i])
        assert found == pytest.approx(expected, rel=1e-7, abs=1e-9)
        power = equations.signed_power(e, law.exponent)
        equation_18 = law.k2 * estimate[i] * power / (a * (e * e + 1.0))
        assert distance_rate[i] == pytest.approx(equation_18, rel=1e-7, abs=1e-9)


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
@given(starts(), gains())
def test_the_reserve_falls_by_k1_alone(start: Start, law: Law) -> None:
    run = drive(start, law)
    sine = np.abs(np.sin(run.alpha))
    cosine_squared = run.states[4]  # the integral of 1 / (1 + e_au^2)
    expected = np.log(sine[0] / start.ratio) - law.k1 * cosine_squared
    np.testing.assert_allclose(np.log(sine * run.distance / run.estimate), expected, atol=1e-6)
    i = len(run.times) // 2
    found = theory.reserve(float(run.e_current[i]), run.distance[i], run.estimate[i])
    assert math.log(found) == pytest.approx(expected[i], abs=1e-6)


@RUNS
@given(starts(concordant=True), gains(k2_low=0.3), floats(1.0, 50.0), floats(1.0, 20.0))
def test_no_gain_makes_the_current_epipole_cross_zero(start, law, faster, ratio) -> None:
    # Proposition 1 asks for a small k2; the reserve shows that any will do, even far from small.
    law = Law(k1=law.k1, k2=faster * law.k2, exponent=law.exponent)
    start = Start(**{**vars(start), 'ratio': ratio})
    run = drive(start, law)
    assert run.ended == 'zeroed'
    sine = np.abs(np.sin(run.alpha))
    least = [
        theory.least_sine(start.e_current, t, k1=law.k1, ratio=start.ratio) for t in run.times
    ]
    assert (sine >= np.array(least) * (1.0 - 1e-6)).all()
    assert (run.e_current * start.e_current > 0.0).all()


def test_the_bound_on_the_current_epipole_is_met_where_it_is_small() -> None:
    run = drive(Start(e_current=0.05, e_desired=0.01), Law(k1=0.2, k2=0.2))
    t = float(run.times[-1])
    least = theory.least_sine(0.05, t, k1=0.2, ratio=1.0)
    assert t > 1.0
    assert abs(math.sin(run.alpha[-1])) == pytest.approx(least, rel=2e-3)  # alpha^2 / 2


def test_it_is_a_small_k2_that_sends_the_robot_away() -> None:
    start = Start(e_current=0.4, e_desired=0.4, ratio=1.5)
    far, near = (
        drive(start, Law(k1=0.3, k2=k2)).distance.max() / start.distance for k2 in (0.06, 3.0)
    )
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
