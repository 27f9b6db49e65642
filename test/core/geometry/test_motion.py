"""The unicycle: exact arcs, angles, limits, and values that refuse what is not finite."""

import math

from hypothesis import example, given
from hypothesis import strategies as st
import pytest
from scipy.integrate import solve_ivp
from strategies import angles, floats, poses, twists

from visual_servo_epipolar.core.geometry.motion import (
    DESIRED_POSE,
    integrate,
    Pose,
    quaternion_from_yaw,
    saturate,
    Twist,
    wrap_angle,
    yaw_from_quaternion,
)


@given(poses(), twists(), floats(0.01, 3.0))
def test_the_arc_solves_equation_4(pose: Pose, twist: Twist, dt: float) -> None:
    def unicycle(_: float, q: list[float]) -> list[float]:
        return [twist.linear * math.cos(q[2]), twist.linear * math.sin(q[2]), twist.angular]

    start = [pose.x, pose.y, pose.theta]
    solved = solve_ivp(unicycle, (0.0, dt), start, rtol=1e-10, atol=1e-12)
    end, (x, y, theta) = integrate(pose, twist, dt), solved.y[:, -1]
    # The solver's own tolerance, accumulated over its steps.
    assert (end.x, end.y) == pytest.approx((x, y), rel=0.0, abs=1e-8)
    assert wrap_angle(end.theta - theta) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize('angular', [0.0, 1e-9, -1e-9, 1e-7])
def test_a_hardly_curved_path_is_a_straight_line(angular: float) -> None:
    end = integrate(DESIRED_POSE, Twist(1.0, angular), 1.0)
    assert end.y == pytest.approx(1.0, abs=1e-14)  # 1 - w^2 / 6
    assert end.x == pytest.approx(-0.5 * angular, rel=1e-6, abs=1e-15)


@given(floats(-1e4, 1e4))
@example(-math.pi)
def test_a_wrapped_angle_is_in_range_and_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    # One unit in the last place of 1e4 rad.
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)
    assert math.sin(wrapped - angle) == pytest.approx(0.0, abs=1e-11)


@given(twists(), floats(0.01, 1.0), floats(0.01, 2.0))
def test_saturation_obeys_both_limits_and_keeps_the_path(twist, linear, angular) -> None:
    limited = saturate(twist, max_linear=linear, max_angular=angular)
    assert abs(limited.linear) <= linear * (1.0 + 1e-15)
    assert abs(limited.angular) <= angular * (1.0 + 1e-15)
    turn = twist.linear * limited.angular - twist.angular * limited.linear
    assert turn == pytest.approx(0.0, abs=1e-14)
    assert limited.linear * twist.linear >= 0.0
    assert saturate(limited, max_linear=2.0 * linear, max_angular=2.0 * angular) == limited


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(('kind', 'values'), [(Twist, 2), (Pose, 3)])
def test_a_value_that_is_not_finite_is_refused(kind, values: int, bad: float) -> None:
    for place in range(values):
        numbers = [0.0] * values
        numbers[place] = bad
        with pytest.raises(ValueError, match=f'{kind.__name__.lower()} must be finite.*{bad}'):
            kind(*numbers)


@given(angles(), floats(0.01, 100.0), st.sampled_from([1.0, -1.0]))
def test_a_quaternion_keeps_its_yaw_whatever_its_norm_and_sign(yaw, norm, sign) -> None:
    scaled = [sign * norm * component for component in quaternion_from_yaw(yaw)]
    assert wrap_angle(yaw_from_quaternion(*scaled) - yaw) == pytest.approx(0.0, abs=1e-14)


@given(floats(-5.0, 5.0), floats(-5.0, 5.0), floats(-179.0, 179.0))
def test_a_start_is_given_against_the_heading_of_the_goal(x: float, y: float, deg: float) -> None:
    start = Pose.from_start(x, y, deg)
    assert math.degrees(start.heading_error) == pytest.approx(deg, abs=1e-12)
    assert (start.x, start.y, start.distance) == (x, y, math.hypot(x, y))
