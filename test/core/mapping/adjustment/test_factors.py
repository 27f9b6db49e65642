"""Factors: the scale tells nothing but itself, attitudes stay near that of the mount."""

from dataclasses import replace
import math

import numpy as np
import pytest

from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.mapping.adjustment.equations import Evaluation
from visual_servo_epipolar.core.mapping.adjustment.factors import Factors, factors_of, LAG
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry, refine
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap


def scaled(geometry: Geometry, ratio: float) -> Geometry:
    """Return the geometry of the same images, had another way been told."""
    window = replace(geometry.window, driven_places=ratio * geometry.window.driven_places)
    factors = factors_of(geometry.evaluation.factors.mount, window, 0.05)
    start = Evaluation(window, geometry.unknowns, geometry.trusted, factors)
    return refine(start, 15)


def test_another_way_makes_the_same_geometry_larger_and_nothing_else(memory: KeyframeMap) -> None:
    before = refine(memory.geometry.evaluation, 10)
    after = scaled(before, 1.2)
    assert after.unknowns.views[:, :2] == pytest.approx(
        1.2 * before.unknowns.views[:, :2], rel=1e-3, abs=2e-4
    )
    trusted = before.trusted
    assert after.unknowns.inverse_depth[trusted] == pytest.approx(
        before.unknowns.inverse_depth[trusted] / 1.2, rel=2e-3
    )
    assert after.unknowns.views[:, 2:] == pytest.approx(before.unknowns.views[:, 2:], abs=2e-5)
    assert after.evaluation.cost == pytest.approx(before.evaluation.cost, abs=0.1)


def test_a_wrong_way_costs_nothing_that_images_could_contradict(exact) -> None:
    wrong = replace(exact.factors, way=2.0 * exact.factors.way)
    fit_pose = refine(
        replace(exact, factors=wrong, unknowns=exact.unknowns.scaled(2.0)), 3
    ).evaluation
    assert fit_pose.cost == pytest.approx(exact.cost, abs=1e-2)


@pytest.mark.parametrize('deviation', [0.02, 0.05, 0.2])
def test_the_scale_is_as_sure_as_the_way_was(exact, deviation: float) -> None:
    factors = replace(exact.factors, scale_deviation=deviation)
    geometry = Geometry(replace(exact, factors=factors))
    root = geometry.root.reshape(-1, geometry.root.shape[1])
    places = exact.unknowns.views[:, :2]
    first = int(np.hypot(*places.T).argmax())
    radial = places[first] / np.hypot(*places[first])
    variance = radial @ (root @ root.T)[5 * first : 5 * first + 2, 5 * first : 5 * first + 2]
    relative = math.sqrt(variance @ radial) / np.hypot(*places[first])
    assert relative == pytest.approx(deviation, rel=0.05)


def test_without_a_way_the_scale_is_a_guess_and_the_geometry_keeps_its_own(exact) -> None:
    window = replace(exact.window, driven_places=np.full((14, 2), np.nan))
    factors = factors_of(Attitude(), window, 0.05)
    assert factors.scale_deviation == 1.0
    assert factors.cost(exact.unknowns) == pytest.approx(
        factors.cost(exact.unknowns.scaled(3.0)), abs=1e-9
    )


def test_derivatives_are_those_of_the_cost(exact) -> None:
    factors = replace(exact.factors, way=1.1 * exact.factors.way)
    at = exact.unknowns
    _, vector = factors.equations(at)
    for index in (0, 1, 6, 23, 24, 70, 71, 72, 73, 74):
        step = np.zeros(len(vector))
        step[index] = 1e-6
        nothing = np.zeros((3, len(at.inverse_depth)))
        there, back = (factors.cost(at.moved(sign * step, nothing)) for sign in (1.0, -1.0))
        assert 2.0 * vector[index] == pytest.approx((there - back) / 2e-6, rel=1e-3, abs=1e-2)


def test_what_views_share_of_their_attitude_is_the_mount_the_rest_the_floor() -> None:
    mount = Attitude(0.0, 0.0, 0.03, 0.03, jitter=0.002)
    information = Factors(mount, 3, 1.0, 0.05).information
    tilts = [3, 8, 13, 15, 18]  # of three views, the photograph, the mount
    covariance = np.linalg.inv(information[np.ix_(tilts, tilts)])
    assert covariance[0, 0] == pytest.approx(0.03**2 + 0.002**2)
    assert covariance[0, 3] == pytest.approx(0.03**2)
    assert covariance[4, 4] == pytest.approx(0.03**2)


def test_a_short_way_tells_little_of_the_scale(exact) -> None:
    def deviation(way: float) -> float:
        driven_places = np.array([[0.0, 0.0], [0.0, way]])
        window = replace(exact.window.without_view(0), driven_places=driven_places)
        return factors_of(Attitude(), window, 0.05).scale_deviation

    assert deviation(10.0) == pytest.approx(0.05, rel=1e-2)
    assert deviation(0.1) == pytest.approx(math.hypot(0.05, LAG / 0.1))
    assert deviation(1e-6) == 1.0
