"""Eqs. (21) to (23): the map from d to D, the Lyapunov function, and the exponential rate."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from strategies import floats, seen_from
import theory_bounds as theory

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.perception.measures import feature_difference

FEATURES = st.lists(
    st.tuples(floats(-2.0, 2.0), floats(-1.5, 1.5), floats(3.0, 8.0)), min_size=1, max_size=8
).filter(lambda rows: all(math.hypot(x, y) > 0.05 for x, y, _ in rows))
BEHIND = st.one_of(floats(-1.5, -0.01), floats(0.01, 6.0))


def difference(points: np.ndarray, behind: float) -> float:
    """Return D through the camera, for a robot ``behind`` [m] the goal on its axis."""
    seen = seen_from(Pose(0.0, -behind, math.pi / 2.0), points)
    return feature_difference(normalised(seen), normalised(points))


def slope(points: np.ndarray, behind: float) -> float:
    return float(
        np.mean([theory.matching_slope(math.hypot(x, y), z, behind) for x, y, z in points])
    )


@given(FEATURES, BEHIND)
def test_23_is_what_the_camera_sees(rows: list[tuple[float, float, float]], behind: float) -> None:
    points = np.array(rows)
    found = difference(points, behind)
    # Differences of squares that are nearly equal lose digits.
    assert found == pytest.approx(-slope(points, behind) * behind, rel=1e-7, abs=1e-13)
    assert slope(points, behind) > 0.0


@given(floats(3.0, 8.0), BEHIND, floats(0.1, 50.0))
def test_on_the_axis_the_map_is_lost(depth: float, behind: float, k_t: float) -> None:
    points = np.array([[0.0, 0.0, depth]])
    assert difference(points, behind) == 0.0
    assert equations.match_features(difference(points, behind), k_t=k_t).linear == 0.0


@settings(max_examples=30)
@given(FEATURES, BEHIND, floats(0.5, 20.0))
def test_proposition_2_the_lyapunov_function_falls_at_the_least_slope(rows, behind, k_t) -> None:
    points = np.array(rows)
    # The least slope on the way: it falls with depth, so it is at one of the two ends.
    least = min(slope(points, behind), slope(points, 0.0))
    duration = 3.0 / (k_t * least)

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [equations.match_features(difference(points, -float(y[0])), k_t=k_t).linear]

    times = np.linspace(0.0, duration, 20)
    found = solve_ivp(rate, (0.0, duration), [-behind], 'LSODA', times, rtol=1e-9, atol=1e-12)
    assert found.success
    y = found.y[0]
    lyapunov = 0.5 * y**2
    # V' = -alpha k_t d^2 (the paper), along the run.
    for position, value in zip(y, lyapunov, strict=True):
        u1 = rate(0.0, np.array([position]))[0]
        expected = -slope(points, -position) * k_t * 2.0 * value
        assert position * u1 == pytest.approx(expected, rel=1e-6, abs=1e-14)
    assert (np.diff(lyapunov) < 0.0).all()
    assert (np.abs(y) <= abs(behind) * np.exp(-k_t * least * times) * (1.0 + 1e-6)).all()


@given(FEATURES, st.lists(BEHIND, min_size=2, max_size=2, unique=True))
def test_the_map_is_monotonic_for_any_number_of_features(rows, pair) -> None:
    points = np.array(rows)
    near, far = sorted(pair)
    if far - near > 1e-6:
        assert difference(points, far) < difference(points, near)
