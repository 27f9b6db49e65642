"""Propositions 1 and 3 with the sign as the paper prints it: where they fail, and how."""

from drives import drive, Law, Start
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats, poses_behind_the_goal

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.gains import longest_transient

SIGNS = st.sampled_from([-1.0, 1.0])
PRINTED = Law(k1=0.05, k2=0.5, printed=True)
TRUE = Law(k1=0.05, k2=0.5)


@settings(max_examples=30)
@given(floats(0.3, 1.0), floats(0.05, 0.6), SIGNS, SIGNS, SIGNS, floats(1.0, 3.0))
def test_the_printed_law_zeroes_e_du_if_signs_agree(e_au, e_du, side, other, sigma, ratio) -> None:
    start = Start(
        e_current=side * e_au, e_desired=other * e_du, sigma=sigma, distance=2.0, ratio=ratio
    )
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
    seen = Bearings.from_pose(pose)
    if seen.epipole_current * seen.epipole_desired == 0.0:
        return
    right = equations.printed_sigma(seen.epipole_current, seen.epipole_desired) == seen.sigma
    assert right == (seen.epipole_current * seen.epipole_desired < 0.0)


def test_the_printed_sign_is_right_in_half_of_all_poses_and_few_everyday_ones() -> None:
    rng = np.random.default_rng(4)

    def share(poses: list[Pose]) -> float:
        seen = [Bearings.from_pose(pose) for pose in poses]
        right = [
            equations.printed_sigma(s.epipole_current, s.epipole_desired) == s.sigma for s in seen
        ]
        return float(np.mean(right))

    anywhere = [Pose(*rng.uniform(-5.0, 5.0, 2), rng.uniform(-np.pi, np.pi)) for _ in range(4000)]
    front = [
        Pose.from_start(rng.uniform(-1.5, 1.5), rng.uniform(-5.0, -2.0), rng.uniform(-15.0, 15.0))
        for _ in range(4000)
    ]
    assert share(anywhere) == pytest.approx(0.5, abs=0.03)  # four deviations
    assert share(front) < 0.35
