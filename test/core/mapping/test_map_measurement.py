"""Reading and recollection: quantities of a measurement, as pose and covariance have it."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.mapping.localization import (
    difference_slope,
    map_measurement_of,
    MapLocalization,
)
from visual_servo_epipolar.core.perception.measures import feature_difference

PLACES = st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, -0.2), st.floats(-1.0, 1.0))
COVARIANCE = np.diag([1e-6, 4e-6, 4e-6, 1e-8, 1e-8])


def recollection(place, covariance=COVARIANCE) -> MapLocalization:
    """Return what would be said of a place."""
    return MapLocalization(
        pose=np.array([*place, 0.0, 0.0]), covariance=covariance, own=0.5 * covariance, depth=5.0
    )


@given(place=PLACES)
@settings(max_examples=40, deadline=None)
def test_bearings_are_those_of_the_pose(place) -> None:
    x, y, heading = place
    expected = Bearings.from_pose(Pose(x, y, heading + 0.5 * math.pi))
    bearings = recollection(place).bearings
    assert math.remainder(bearings.psi - expected.psi, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert math.remainder(bearings.phi - expected.phi, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert bearings.heading_error == pytest.approx(heading, abs=1e-9)


@given(place=PLACES)
@settings(max_examples=20, deadline=None)
def test_covariance_of_bearings_is_that_of_poses_around(place) -> None:
    rng = np.random.default_rng(1)
    root = np.linalg.cholesky(COVARIANCE[:3, :3])
    poses = np.array(place) + rng.normal(size=(4000, 3)) @ root.T
    psi = np.arctan2(poses[:, 1], poses[:, 0])
    drawn = np.cov(np.stack([psi, psi - poses[:, 2]]))
    told = recollection(place).bearings_covariance
    assert np.sqrt(np.diag(told)) == pytest.approx(np.sqrt(np.diag(drawn)), rel=0.05)


def test_at_the_goal_itself_there_are_no_bearings_but_offsets() -> None:
    said = recollection((0.0, 0.0, 0.01))
    assert said.bearings is None
    assert said.lateral_deviation == pytest.approx(1e-3)
    assert said.longitudinal_deviation == pytest.approx(2e-3)
    slope = difference_slope(np.array([[0.6, 0.0, 0.8]]), np.array([0.2]))
    reading = map_measurement_of(said, slope)
    assert reading.bearings is None
    assert (reading.lateral, reading.difference) == (0.0, 0.0)
    assert math.isfinite(reading.difference_deviation)


@pytest.mark.parametrize('wide', [False, True])
def test_difference_is_that_of_features_seen_from_there(wide: bool) -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-1.5, 1.5, (40, 2)), rng.uniform(3.0, 8.0, 40)])
    length = np.linalg.norm(points, axis=1)
    desired = points / length[:, None]
    moved = points - [0.0, 0.0, 1e-4]
    current = moved / np.linalg.norm(moved, axis=1)[:, None]
    expected = float(feature_difference(current, desired, wide)) / 1e-4
    assert difference_slope(desired, 1.0 / length, wide=wide) == pytest.approx(expected, rel=1e-3)


def test_a_reading_tells_offsets_in_depths_whatever_the_scale() -> None:
    said = recollection((0.01, -0.02, 0.0))
    larger = replace(
        said, pose=said.pose * [2, 2, 1, 1, 1], covariance=4.0 * said.covariance, depth=10.0
    )
    ray = np.array([[0.6, 0.0, 0.8]])
    one, other = (
        map_measurement_of(each, difference_slope(ray, np.array([1.0 / each.depth])))
        for each in (said, larger)
    )
    assert one.difference == pytest.approx(other.difference)
    assert one.difference < 0.0  # behind the goal
    assert one.parallax == pytest.approx(other.parallax)
    assert one.own == pytest.approx(tuple(np.sqrt(0.5 * np.diag(COVARIANCE)[:3])))
