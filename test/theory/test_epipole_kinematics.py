"""Eqs. (5) to (10) against finite differences, in all sign cases; what the printed sign does."""

import math

from drives import drive, Law, Start
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, pose_with, poses_behind_the_goal, twists
import theory_bounds as theory

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.gains import longest_transient

STEP = 1e-6  # of the central differences [s]
CASES = [
    (current, desired, sigma, ahead)
    for current in (-1.0, 1.0)
    for desired in (-1.0, 1.0)
    for sigma in (-1.0, 1.0)
    for ahead in (False, True)
]
MAGNITUDES = floats(0.05, 5.0)
DISTANCES = floats(0.3, 8.0)
SIGNS = st.sampled_from([-1.0, 1.0])
all_cases = pytest.mark.parametrize(('current', 'desired', 'sigma', 'ahead'), CASES)


def derivatives(pose: Pose, twist: Twist, values: object) -> np.ndarray:
    after, before = (
        np.array(values(Bearings.from_pose(integrate(pose, twist, t))))  # type: ignore[operator]
        for t in (STEP, -STEP)
    )
    return np.asarray((after - before) / (2.0 * STEP))


def abscissae(seen: Bearings) -> tuple[float, float]:
    return seen.epipole_current, seen.epipole_desired


@all_cases
@given(a=MAGNITUDES, e=MAGNITUDES, distance=DISTANCES)
def test_5_and_6_are_as_printed(current, desired, sigma, ahead, a, e, distance) -> None:
    pose = pose_with(current * a, desired * e, sigma=sigma, distance=distance, ahead=ahead)
    x, y, theta = pose.x, pose.y, pose.theta
    sine, cosine = math.sin(theta), math.cos(theta)
    printed = (x * sine - y * cosine) / (x * cosine + y * sine)
    assert abscissae(Bearings.from_pose(pose)) == pytest.approx((printed, x / y), rel=1e-9)


@all_cases
@given(a=MAGNITUDES, e=MAGNITUDES, distance=DISTANCES, twist=twists(), f=floats(0.2, 5.0))
def test_7_to_10_are_derivatives(current, desired, sigma, ahead, a, e, distance, twist, f) -> None:
    pose = pose_with(current * a, desired * e, sigma=sigma, distance=distance, ahead=ahead)
    seen = Bearings.from_pose(pose)
    found = derivatives(pose, twist, abscissae)
    # A difference over 2e-6 s of abscissae up to 5, whose third derivative grows with their cube.
    tolerance = {'rel': 1e-6, 'abs': 2e-6}
    eight_and_seven = theory.rates_in_bearings(twist, seen, distance)
    assert found == pytest.approx(eight_and_seven, **tolerance)
    for focal in (1.0, f):
        epipoles = [focal * each for each in abscissae(seen)]
        rates = equations.epipole_rates(
            twist, *epipoles, sigma=sigma, distance=distance, focal=focal
        )
        assert found == pytest.approx(np.array(rates) / focal, **tolerance)


@all_cases
@given(a=MAGNITUDES, e=MAGNITUDES, distance=DISTANCES, speed=floats(-1.0, 1.0))
def test_printed_9_and_10_hold_if_signs_agree(
    current, desired, sigma, ahead, a, e, distance, speed
):
    pose = pose_with(current * a, desired * e, sigma=sigma, distance=distance, ahead=ahead)
    found = derivatives(pose, Twist(speed, 0.0), abscissae)
    sign = equations.printed_sigma(current, desired)
    printed = np.array(
        equations.epipole_rates(
            Twist(speed, 0.0), current * a, desired * e, sigma=sign, distance=distance
        )
    )
    # The paper's "sign functions guarantee that these hold for any position": in half the cases
    # they give the opposite of the derivative.
    np.testing.assert_allclose(found, sign * sigma * printed, rtol=1e-6, atol=2e-6)


PRINTED = Law(k1=0.05, k2=0.5, printed=True)
TRUE = Law(k1=0.05, k2=0.5)


@settings(max_examples=30)
@given(floats(0.3, 1.0), floats(0.05, 0.6), SIGNS, SIGNS, SIGNS, floats(1.0, 3.0))
def test_the_printed_law_zeroes_e_du_if_signs_agree(e_au, e_du, side, other, sigma, ratio) -> None:
    place = {'sigma': sigma, 'distance': 2.0, 'ratio': ratio}
    start = Start(e_current=side * e_au, e_desired=other * e_du, **place)
    latest = longest_transient(e_du, k2=PRINTED.k2, exponent=PRINTED.exponent)
    agrees = side * other == sigma
    run = drive(start, PRINTED, duration=0.3 * latest)
    falls = np.abs(run.e_desired[-1]) < e_du
    assert falls == agrees
    assert abs(drive(start, TRUE, duration=0.3 * latest).e_desired[-1]) < e_du


def test_a_counterexample_to_proposition_1_as_printed() -> None:
    # 3 m behind the goal, 0.8 m to the right, looking 5 deg past the goal's heading: d_hat_0 = d_0
    # and e_au is not zero, which is all that the proposition asks for.
    pose = Pose.from_start(0.8, -3.0, -5.0)
    seen = Bearings.from_pose(pose)
    start = Start(
        e_current=seen.epipole_current,
        e_desired=seen.epipole_desired,
        sigma=seen.sigma,
        distance=pose.distance,
    )
    assert start.pose.x == pytest.approx(pose.x)
    latest = longest_transient(start.e_desired, k2=0.5, exponent=PRINTED.exponent)
    for k2 in (0.5, 0.05, 0.005):  # however small
        law = Law(k1=1e-3 * k2, k2=k2, printed=True)
        run = drive(start, law, duration=0.5 / k2 * latest)
        assert (np.diff(np.abs(run.e_desired)) > 0.0).all()
        assert (np.diff(run.states[1]) > 0.0).all()  # on its way to y = 0, where e_du is infinite
    run = drive(start, TRUE)
    assert run.ended == 'zeroed'


@given(poses_behind_the_goal())
def test_behind_the_goal_the_printed_sign_is_right_for_discordant_epipoles_alone(pose) -> None:
    # The everyday start: sigma is -1, and with discordant epipoles alone the robot comes nearer.
    seen = Bearings.from_pose(pose)
    assert seen.sigma == -1.0
    if seen.epipole_current * seen.epipole_desired == 0.0:
        return
    right = equations.printed_sigma(seen.epipole_current, seen.epipole_desired) == seen.sigma
    assert right == (seen.epipole_current * seen.epipole_desired < 0.0)
