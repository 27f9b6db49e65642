"""The control laws held against the paper: rates, closed loops, closed forms and convergence."""

from collections.abc import Callable
import math
from typing import Any

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from strategies import floats, pose_with, regular_poses, twists

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.laws import equations

EXPONENT = 5.0 / 9.0  # beta / gamma of the first simulation of the paper
RESIDUE = 1e-4  # where an integrated run stops: past it the law is not Lipschitz
SIGMAS = st.sampled_from([-1.0, 1.0])
ABSCISSAE = st.one_of(floats(-3.0, -0.02), floats(0.02, 3.0))
DISTANCES = floats(0.1, 20.0)
FOCALS = floats(0.2, 5.0)

Control = Callable[[Bearings, float], Twist]


def drive(
    pose: Pose, distance: float, control: Control, *, duration: float, focal: float = 1.0
) -> Any:
    """
    Integrate unicycle and d_hat under ``control`` until e_du or time runs out.

    ``control`` takes bearings and d_hat; ``focal`` is the guess with which (25) updates d_hat.
    Rows of the answer's y are x, y, theta, d_hat.
    """

    def rates(_: float, q: np.ndarray) -> list[float]:
        bearings = Bearings.from_pose(Pose(*q[:3]))
        twist = control(bearings, q[3])
        return [
            twist.linear * math.cos(q[2]),
            twist.linear * math.sin(q[2]),
            twist.angular,
            equations.distance_rate(
                twist.linear, bearings.epipole_current, sigma=bearings.sigma, focal=focal
            ),
        ]

    def desired_residue(_: float, q: np.ndarray) -> float:
        return abs(Bearings.from_pose(Pose(*q[:3])).epipole_desired) - RESIDUE

    desired_residue.terminal = True  # type: ignore[attr-defined]
    start = [pose.x, pose.y, pose.theta, distance]
    times = np.linspace(0.0, duration, 50)
    solution = solve_ivp(
        rates,
        (0.0, duration),
        start,
        'DOP853',
        times,
        events=desired_residue,
        rtol=1e-10,
        atol=1e-12,
    )
    assert solution.success
    solution.bearings = [Bearings.from_pose(Pose(*q[:3])) for q in solution.y.T]
    return solution


def first_step(*, k1: float, k2: float, focal: float = 1.0, finite: bool = False) -> Control:
    """Return (16)-(17), as Control, for epipoles at unit focal length."""
    rule = equations.finite_time_controls if finite else equations.auxiliary_controls

    def control(bearings: Bearings, distance: float) -> Twist:
        e_current, e_desired = bearings.epipole_current, bearings.epipole_desired
        return equations.linearizing_control(
            e_current,
            e_desired,
            sigma=bearings.sigma,
            distance=distance,
            nu=rule(e_current, e_desired, k1=k1, k2=k2, exponent=EXPONENT),
            focal=focal,
        )

    return control


def discordant(value: float, like: float) -> float:
    return -math.copysign(value, like)


@given(regular_poses(), twists())
def test_the_rates_are_the_derivatives_of_the_epipoles(pose: Pose, twist: Twist) -> None:
    dt = 1e-6
    before, after = (Bearings.from_pose(integrate(pose, twist, t)) for t in (-dt, dt))
    bearings = Bearings.from_pose(pose)
    epipole_rates = equations.epipole_rates(
        twist,
        bearings.epipole_current,
        bearings.epipole_desired,
        sigma=bearings.sigma,
        distance=pose.distance,
    )
    expected = (
        (after.epipole_current - before.epipole_current) / (2.0 * dt),
        (after.epipole_desired - before.epipole_desired) / (2.0 * dt),
    )
    # Rounding of a difference over 2e-6 s, of abscissae up to 10.
    assert epipole_rates == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(regular_poses(), twists())
def test_the_distance_rate_is_the_derivative_of_the_distance(pose: Pose, twist: Twist) -> None:
    dt = 1e-6
    bearings = Bearings.from_pose(pose)
    rate = equations.distance_rate(twist.linear, bearings.epipole_current, sigma=bearings.sigma)
    before, after = (integrate(pose, twist, t).distance for t in (-dt, dt))
    assert rate == pytest.approx((after - before) / (2.0 * dt), abs=1e-8)


@given(ABSCISSAE, ABSCISSAE, SIGMAS, DISTANCES, DISTANCES, FOCALS, floats(0.01, 2.0))
def test_the_closed_loop_is_14_and_15(e_au, e_du, sigma, d, d_hat, f, k1) -> None:
    k2 = 0.5
    nu = equations.auxiliary_controls(e_au, e_du, k1=k1, k2=k2, exponent=EXPONENT)
    twist = equations.linearizing_control(e_au, e_du, sigma=sigma, distance=d_hat, nu=nu, focal=f)
    rates = equations.epipole_rates(twist, e_au, e_du, sigma=sigma, distance=d, focal=f)
    push = (e_au**2 + f**2) / (e_du**2 + f**2) * k2 * equations.signed_power(e_du, EXPONENT)
    equation_14 = -k1 * e_au - (d_hat / d - 1.0) * push
    equation_15 = -d_hat / d * k2 * equations.signed_power(e_du, EXPONENT)
    # Terms of d_hat / d (up to 200) times the push cancel.
    rounding = 1e-13 * (1.0 + d_hat / d) * abs(push)
    assert rates[0] == pytest.approx(equation_14, rel=1e-12, abs=rounding)
    assert rates[1] == pytest.approx(equation_15, rel=1e-12)


@given(ABSCISSAE, ABSCISSAE, SIGMAS, DISTANCES, FOCALS)
def test_the_inputs_are_16_and_17(e_au, e_du, sigma, d_hat, f) -> None:
    k1, k2 = 0.08, 1.0
    nu = equations.auxiliary_controls(e_au, e_du, k1=k1, k2=k2, exponent=EXPONENT)
    twist = equations.linearizing_control(e_au, e_du, sigma=sigma, distance=d_hat, nu=nu, focal=f)
    power = k2 * math.copysign(abs(e_du) ** EXPONENT, e_du)
    root = math.sqrt(e_au**2 + f**2)
    assert twist.linear == pytest.approx(
        sigma * d_hat * f * root / (e_au * (e_du**2 + f**2)) * power
    )
    turn = -f / (e_au**2 + f**2) * k1 * e_au + f / (e_du**2 + f**2) * power
    assert twist.angular == pytest.approx(turn, abs=1e-14)


@given(ABSCISSAE, ABSCISSAE, SIGMAS, DISTANCES, FOCALS, floats(0.01, 2.0))
def test_velocities_need_no_unit_of_the_image(e_au, e_du, sigma, d_hat, scale, rate) -> None:
    def control(unit: float) -> Twist:
        nu = (-rate * e_au * unit, rate * e_du * unit)
        return equations.linearizing_control(
            unit * e_au, unit * e_du, sigma=sigma, distance=d_hat, nu=nu, focal=unit
        )

    metric, scaled = control(1.0), control(769.0 * scale)
    assert scaled.linear == pytest.approx(metric.linear, rel=1e-12)
    assert scaled.angular == pytest.approx(metric.angular, rel=1e-12, abs=1e-14)


@given(ABSCISSAE, ABSCISSAE, SIGMAS, DISTANCES, FOCALS)
def test_the_update_by_the_applied_speed_is_13_and_25(e_au, e_du, sigma, d_hat, f) -> None:
    k2 = 0.7
    nu = equations.auxiliary_controls(e_au, e_du, k1=0.1, k2=k2, exponent=EXPONENT)
    twist = equations.linearizing_control(e_au, e_du, sigma=sigma, distance=d_hat, nu=nu, focal=f)
    power = equations.signed_power(e_du, EXPONENT)
    equation_13 = k2 * f**2 * d_hat * power / (e_au * (e_du**2 + f**2))
    rate = equations.distance_rate(twist.linear, e_au, sigma=sigma, focal=f)
    assert rate == pytest.approx(equation_13, rel=1e-12)


@given(ABSCISSAE, ABSCISSAE, SIGMAS, DISTANCES)
def test_the_goal_comes_nearer_iff_the_epipoles_are_discordant(e_au, e_du, sigma, d_hat) -> None:
    nu = equations.auxiliary_controls(e_au, e_du, k1=0.1, k2=0.5, exponent=EXPONENT)
    twist = equations.linearizing_control(e_au, e_du, sigma=sigma, distance=d_hat, nu=nu)
    assert (equations.distance_rate(twist.linear, e_au, sigma=sigma) < 0.0) == (e_au * e_du < 0.0)


@given(floats(-1e3, 1e3), floats(0.05, 1.0))
def test_a_signed_power_is_odd(value: float, exponent: float) -> None:
    power = equations.signed_power(value, exponent)
    assert power == -equations.signed_power(-value, exponent)
    assert power * value >= 0.0


def test_nothing_is_singular_once_the_desired_epipole_is_zero() -> None:
    twist = equations.linearizing_control(0.0, 0.0, sigma=-1.0, distance=5.0, nu=(-0.1, 0.0))
    assert twist == Twist(0.0, -0.1)


# Starts of integrated runs: |atan e_au| + |atan e_du| stays below 90 deg, so that the perturbation
# of (14) cannot carry e_au to infinity; e_au large enough that d changes by less than e^4.
CURRENT, DESIRED = floats(0.4, 0.8), floats(0.05, 0.8)
SIGNS = st.sampled_from([-1.0, 1.0])


@settings(max_examples=20)
@given(CURRENT, DESIRED, SIGNS, SIGNS, SIGMAS, floats(0.5, 5.0))
def test_at_the_true_distance_they_follow_closed_forms(
    e_au: float, e_du: float, sign_au: float, sign_du: float, sigma: float, d: float
) -> None:
    e_au, e_du, k1, k2 = sign_au * e_au, sign_du * e_du, 0.1, 0.5
    pose = pose_with(e_au, e_du, sigma=sigma, distance=d)
    run = drive(pose, d, first_step(k1=k1, k2=k2), duration=20.0)
    rest = 1.0 - EXPONENT
    # (15) with d_hat = d: |e|^(1-b) = |e_0|^(1-b) - k2 (1-b) t; (14): an exponential.
    power = abs(e_du) ** rest - k2 * rest * run.t
    desired = math.copysign(1.0, e_du) * power ** (1.0 / rest)
    epipoles = np.array([(it.epipole_current, it.epipole_desired) for it in run.bearings])
    # The solver's tolerance, grown along the run.
    np.testing.assert_allclose(epipoles[:, 0], e_au * np.exp(-k1 * run.t), rtol=1e-5)
    np.testing.assert_allclose(epipoles[:, 1], desired, atol=1e-7)
    zeroed = (abs(e_du) ** rest - RESIDUE**rest) / (k2 * rest)
    assert run.t_events[0] == pytest.approx([zeroed], rel=1e-5)


@settings(max_examples=20)
@given(CURRENT, DESIRED, SIGNS, SIGMAS, floats(0.5, 5.0), floats(1.0, 4.0))
def test_d_hat_keeps_its_lead_over_the_distance(e_au, e_du, sign, sigma, d, over) -> None:
    pose = pose_with(discordant(e_au, sign), sign * e_du, sigma=sigma, distance=d)
    run = drive(pose, over * d, first_step(k1=0.1, k2=0.5), duration=20.0)
    # (19): both obey the same equation, whatever the lead was.
    lead = run.y[3] - np.hypot(run.y[0], run.y[1])
    np.testing.assert_allclose(lead, (over - 1.0) * d, atol=1e-7)


@settings(max_examples=20)
@given(CURRENT, DESIRED, SIGNS, SIGMAS, floats(0.5, 5.0), floats(1.0, 4.0))
def test_an_overestimate_but_hastens_the_desired_epipole(e_au, e_du, sign, sigma, d, over) -> None:
    k2, rest = 0.5, 1.0 - EXPONENT
    pose = pose_with(discordant(e_au, sign), sign * e_du, sigma=sigma, distance=d)
    run = drive(pose, over * d, first_step(k1=0.1, k2=k2), duration=20.0)
    # Section IV-C: t_max is that of d_hat = d.
    assert run.t_events[0].size == 1
    assert run.t_events[0][0] <= e_du**rest / (k2 * rest) + 1e-9


@given(floats(-1.2, 1.2), SIGMAS, floats(0.3, 5.0), floats(0.05, 1.0))
def test_once_the_desired_epipole_is_0_the_robot_turns_exponentially(e_au, sigma, d, k1) -> None:
    start = pose_with(e_au, 0.0, sigma=sigma, distance=d)
    pose, dt = start, 1e-3
    for _ in range(500):
        e_current = Bearings.from_pose(pose).epipole_current
        nu = equations.auxiliary_controls(e_current, 0.0, k1=k1, k2=0.5, exponent=EXPONENT)
        twist = equations.linearizing_control(e_current, 0.0, sigma=sigma, distance=9.0, nu=nu)
        pose = integrate(pose, twist, dt)
    e_current = Bearings.from_pose(pose).epipole_current
    # Euler's error: half a step of 1 ms, times the rate, times the curvature of the tangent.
    assert e_current == pytest.approx(e_au * math.exp(-k1 * 0.5), rel=2e-3, abs=1e-12)
    assert (pose.x, pose.y) == (start.x, start.y)


@given(floats(-1.2, 1.2), floats(-1.2, 1.2), floats(-2.0, 2.0), SIGMAS, floats(0.05, 1.0))
def test_the_preliminary_turn_is_exponential_to_its_target(e_au, target, e_du, sigma, k1) -> None:
    pose = pose_with(e_au, e_du, sigma=sigma, distance=2.0)
    dt = 1e-3
    for _ in range(500):
        e_current = Bearings.from_pose(pose).epipole_current
        pose = integrate(pose, equations.turn_epipole(e_current, target, k1=k1), dt)
    expected = target + (e_au - target) * math.exp(-k1 * 0.5)
    after = Bearings.from_pose(pose)
    # Euler's error over 0.5 s in steps of 1 ms, as above.
    assert after.epipole_current == pytest.approx(expected, abs=2e-3 * abs(e_au - target) + 1e-12)
    assert after.epipole_desired == pytest.approx(e_du, abs=1e-12)


@settings(max_examples=20)
@given(CURRENT, DESIRED, SIGNS, SIGNS, SIGMAS)
def test_20_zeroes_both_epipoles_in_finite_time(e_au, e_du, sign_au, sign_du, sigma) -> None:
    k2, rest = 0.5, 1.0 - EXPONENT
    k1 = 0.5 * k2 * (e_au / e_du) ** rest  # half of what the paper allows: e_du is first
    pose = pose_with(sign_au * e_au, sign_du * e_du, sigma=sigma, distance=2.0)
    run = drive(pose, 2.0, first_step(k1=k1, k2=k2, finite=True), duration=20.0)
    powers = np.array([abs(it.epipole_current) ** rest for it in run.bearings])
    # |e_au|^(1-b) falls in a straight line, which meets zero at a finite time, after e_du's.
    np.testing.assert_allclose(powers, e_au**rest - k1 * rest * run.t, atol=1e-6)
    assert run.t_events[0][0] < e_au**rest / (k1 * rest)


@given(ABSCISSAE, ABSCISSAE, SIGMAS, DISTANCES, DISTANCES, FOCALS, floats(0.2, 1.0))
def test_with_a_guessed_focal_length_it_is_26_and_27(e_au, e_du, sigma, d, d_hat, f, part) -> None:
    k1, k2, g = 0.3, 0.5, part * f  # g stands for f_hat
    nu = equations.auxiliary_controls(e_au, e_du, k1=k1, k2=k2, exponent=EXPONENT)
    twist = equations.linearizing_control(e_au, e_du, sigma=sigma, distance=d_hat, nu=nu, focal=g)
    rates = equations.epipole_rates(twist, e_au, e_du, sigma=sigma, distance=d, focal=f)
    power = k2 * equations.signed_power(e_du, EXPONENT)
    root, guess = math.sqrt(e_au**2 + f**2), math.sqrt(e_au**2 + g**2)
    push = g / f * root / (e_du**2 + g**2) * power
    equation_26 = -g / f * root**2 / guess**2 * k1 * e_au - push * (d_hat / d * guess - root)
    equation_27 = -g / f * (e_du**2 + f**2) / (e_du**2 + g**2) * guess / root * d_hat / d * power
    rounding = 1e-13 * abs(push) * (d_hat / d * guess + root)
    assert rates[0] == pytest.approx(equation_26, rel=1e-12, abs=rounding)
    assert rates[1] == pytest.approx(equation_27, rel=1e-12)


@given(ABSCISSAE, SIGMAS, FOCALS, floats(0.2, 1.0))
def test_the_distance_changes_mu_times_as_fast_as_d_hat(e_au, sigma, f, part) -> None:
    guess = part * f
    true = equations.distance_rate(1.0, e_au, sigma=sigma, focal=f)
    mu = true / equations.distance_rate(1.0, e_au, sigma=sigma, focal=guess)
    expected = f / guess * math.sqrt((e_au**2 + guess**2) / (e_au**2 + f**2))
    assert mu == pytest.approx(expected, rel=1e-12)  # (29)
    assert 1.0 - 1e-12 <= mu <= f / guess + 1e-12  # (30)


@settings(max_examples=20)
@given(CURRENT, DESIRED, SIGNS, SIGMAS, floats(0.5, 5.0), floats(0.5, 1.0))
def test_both_epipoles_converge_with_a_focal_too_short(e_au, e_du, sign, sigma, d, guess) -> None:
    k1, k2 = 0.3, 0.5
    control = first_step(k1=k1, k2=k2, focal=guess)
    pose = pose_with(discordant(e_au, sign), sign * e_du, sigma=sigma, distance=d)
    run = drive(pose, 1.5 * d, control, duration=60.0, focal=guess)
    # Proposition 3: (27) is never slower than f_hat^2 / f^2 times (15) with the least d_hat / d.
    assert run.t_events[0].size == 1
    aligned = Pose(0.0, *run.y_events[0][0][1:3])
    current = Bearings.from_pose(aligned).epipole_current
    for _ in range(4000):  # 40 s at rate k1 or faster: 0.8 exp(-12)
        aligned = integrate(
            aligned,
            equations.linearizing_control(
                current, 0.0, sigma=sigma, distance=d, nu=(-k1 * current, 0.0), focal=guess
            ),
            0.01,
        )
        current = Bearings.from_pose(aligned).epipole_current
    assert abs(current) < 1e-4


@given(floats(0.02, 3.0), floats(0.3, 0.95))
def test_the_rate_of_26_falls_below_k1_where_the_epipole_is_far_out(e_au, guess) -> None:
    k1 = 0.3
    twist = equations.linearizing_control(
        e_au, 0.0, sigma=-1.0, distance=1.0, nu=(-k1 * e_au, 0.0), focal=guess
    )
    rate = -equations.epipole_rates(twist, e_au, 0.0, sigma=-1.0, distance=1.0)[0] / e_au
    # The paper claims at least k1 everywhere; it forgets the factor f_hat / f of (26). With it,
    # the claim holds where e_au^2 <= f f_hat, and there only.
    assert (rate >= k1 * (1.0 - 1e-12)) == (e_au**2 <= guess * (1.0 + 1e-12))


@given(
    st.one_of(floats(-3.0, -1e-6), floats(1e-6, 3.0)),
    floats(0.05, 0.95),
    FOCALS,
    floats(0.05, 0.5),
)
def test_the_displaced_epipole_is_discordant_and_within_its_bounds(e_du, room, focal, low) -> None:
    target = equations.displaced_epipole(e_du, ratio=room, low=low, high=low + 0.2, focal=focal)
    assert target * e_du < 0.0
    assert low - 1e-12 <= math.atan(abs(target) / focal) <= low + 0.2 + 1e-12


@settings(max_examples=20)
@given(floats(0.1, 0.8), SIGNS, SIGMAS, floats(0.3, 0.7), st.booleans())
def test_holding_the_displaced_epipole_spirals_with_room(e_du, sign, sigma, room, ahead) -> None:
    target = equations.displaced_epipole(sign * e_du, ratio=room, low=0.05, high=1.2)
    start = pose_with(target, sign * e_du, sigma=sigma, distance=3.0, ahead=ahead)

    def spiral(bearings: Bearings, distance: float) -> Twist:
        e_au, desired = bearings.epipole_current, bearings.epipole_desired
        nu = equations.auxiliary_controls(
            e_au, desired, k1=0.8, k2=0.5, exponent=EXPONENT, e_target=target
        )
        return equations.linearizing_control(
            e_au, desired, sigma=bearings.sigma, distance=distance, nu=nu
        )

    run = drive(start, 3.0, spiral, duration=20.0)
    alpha = math.atan(abs(target))
    end = Pose(*run.y_events[0][0][:3])
    # ln(d_end / d_0) = -|chi_0| / tan(alpha); the run stops RESIDUE short of chi = 0.
    expected = math.exp(-(math.atan(e_du) - RESIDUE) / math.tan(alpha))
    assert end.distance / 3.0 == pytest.approx(expected, rel=1e-5)
    assert expected == pytest.approx(room, rel=1e-2)
    assert Bearings.from_pose(end).epipole_current == pytest.approx(target, rel=1e-6)


# Three features of a scene 3 to 8 m ahead of the goal: X, Y, Z [m].
SCENE = np.array([[1.0, 0.4, 3.0], [-2.0, 1.0, 8.0], [0.5, -0.8, 5.0]])


def difference_at(y: float) -> float:
    """Return D of (23) for a robot on the line of the goal, ``y`` ahead of it (or behind)."""
    norm = (SCENE[:, :2] ** 2).sum(axis=1)
    return float((norm / (SCENE[:, 2] - y) ** 2 - norm / SCENE[:, 2] ** 2).mean())


@given(st.one_of(floats(-5.0, -1e-3), floats(1e-3, 2.0)), floats(0.1, 50.0))
def test_the_second_step_drives_towards_the_goal_from_either_side(y: float, k_t: float) -> None:
    twist = equations.match_features(difference_at(y), k_t=k_t)
    assert twist.linear * y < 0.0
    assert twist.angular == 0.0


@given(st.one_of(floats(-0.01, -1e-4), floats(1e-4, 0.01)))
def test_the_difference_decreases_exponentially_near_the_goal(y: float) -> None:
    k_t, dt, steps = 5.0, 1e-3, 1000
    slope = float((2.0 * (SCENE[:, :2] ** 2).sum(axis=1) / SCENE[:, 2] ** 3).mean())
    start = difference_at(y)
    pose = Pose(0.0, y, math.pi / 2.0)
    for _ in range(steps):
        pose = integrate(pose, equations.match_features(difference_at(pose.y), k_t=k_t), dt)
    # D = alpha y to first order: 1 % at 10 mm.
    expected = start * math.exp(-k_t * slope * dt * steps)
    assert difference_at(pose.y) == pytest.approx(expected, rel=0.01)


@given(floats(0.1, 20.0), floats(0.1, 20.0), floats(0.1, 50.0))
def test_the_adaptive_gain_runs_from_one_value_to_the_other(at_zero, far, slope) -> None:
    def gain(size: float) -> float:
        return equations.adaptive_gain(size, at_zero=at_zero, far=far, slope=slope)

    span = abs(at_zero - far)
    assume(span > 0.01)
    assert gain(0.0) == pytest.approx(at_zero)
    assert gain(-0.1) == gain(0.1)
    assert gain(40.0 * span / slope) == pytest.approx(far, rel=1e-9)
    # The slope at zero is the one that was asked for, by a difference quotient.
    step = 1e-5 * span / slope
    assert abs(gain(step) - gain(0.0)) / step == pytest.approx(slope, rel=1e-3)


def test_an_adaptive_gain_of_equal_ends_is_constant() -> None:
    assert equations.adaptive_gain(0.3, at_zero=2.0, far=2.0, slope=0.0) == 2.0


@given(floats(0.05, 5.0), floats(0.001, 0.5), SIGNS, floats(0.05, 2.0), floats(0.05, 1.5))
def test_the_braking_speed_is_enough_to_stop(way, bearing, sign, speed, deceleration) -> None:
    # The bearing closes in proportion to the remaining distance, by a scale that nobody knows.
    rate = -sign * bearing * speed / way
    limit = equations.braking_speed(sign * bearing, rate, deceleration=deceleration)
    # At the speed v itself v^2 / (2 a) = way: the bound on v is 2 a way / v.
    assert limit == pytest.approx(2.0 * deceleration * way / speed)
    assert (limit >= speed * (1.0 - 1e-9)) == (speed**2 / (2.0 * deceleration) <= way * (1 + 1e-9))


@pytest.mark.parametrize(('bearing', 'rate'), [(0.1, 0.2), (-0.1, -0.2), (0.1, 0.0), (0.0, 0.3)])
def test_nothing_brakes_a_robot_that_is_not_closing_in(bearing: float, rate: float) -> None:
    assert equations.braking_speed(bearing, rate, deceleration=0.2) == math.inf
