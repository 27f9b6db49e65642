"""Factors: the scale tells nothing but itself, attitudes stay near that of the mount."""

from dataclasses import replace
import math

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.factors import factors_of
from visual_servo_epipolar.core.mapping.refinement import (
    Geometry,
    OUTLIER,
    refine,
    robust_cost,
    robust_weight,
    system_of,
)
from visual_servo_epipolar.core.mapping.window import MapSettings, Unknowns
from visual_servo_epipolar.core.twoview.estimator import Attitude


def test_a_wrong_way_costs_nothing_that_images_could_contradict(exact) -> None:
    wrong = replace(exact.factors, way=2.0 * exact.factors.way)
    twice = replace(exact, factors=wrong, unknowns=exact.unknowns.scaled(2.0))
    assert refine(twice, 3).evaluation.cost == pytest.approx(exact.cost, abs=1e-2)


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
    factors = factors_of(Attitude(), window, MapSettings())
    assert factors.scale_deviation == 1.0
    larger = factors.cost(exact.unknowns.scaled(3.0))
    assert factors.cost(exact.unknowns) == pytest.approx(larger, abs=1e-9)


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


def test_a_short_way_tells_little_of_the_scale(exact) -> None:
    def deviation(way: float) -> float:
        driven_places = np.array([[0.0, 0.0], [0.0, way]])
        window = replace(exact.window.without_view(0), driven_places=driven_places)
        return factors_of(Attitude(), window, MapSettings()).scale_deviation

    assert deviation(10.0) == pytest.approx(0.05, rel=1e-2)
    assert deviation(0.1) == pytest.approx(math.hypot(0.05, 0.02 / 0.1))
    assert deviation(1e-6) == 1.0


def moved(exact, seed=0):
    """Return the evaluation a little off the truth."""
    rng = np.random.default_rng(seed)
    at = exact.unknowns
    count = len(at.inverse_depth)
    unknowns = Unknowns(
        at.views + 1e-3 * rng.normal(size=at.views.shape),
        at.shared + 1e-3 * rng.normal(size=5),
        at.offsets + 0.5 * rng.normal(size=(2, count)),
        at.inverse_depth * (1.0 + 1e-3 * rng.normal(size=count)),
    )
    return replace(exact, unknowns=unknowns)


def test_weights_are_slopes_of_the_cost() -> None:
    squares = np.array([0.1, 3.0, 8.9, 9.1, 20.0, 400.0])
    step = 1e-5
    slope = (robust_cost(squares + step) - robust_cost(squares - step)) / (2.0 * step)
    assert robust_weight(squares) == pytest.approx(slope, rel=1e-4)
    assert robust_weight(np.array([0.0, OUTLIER])).tolist() == [1.0, 1.0]
    assert robust_cost(np.array([1e12]))[0] == pytest.approx(2.0 * OUTLIER)


def test_a_feature_that_is_not_trusted_moves_no_view(exact) -> None:
    at = moved(exact)
    far = at.unknowns.offsets.copy()
    far[:, 0] += 3.0
    trusted = at.trusted.copy()
    trusted[0] = False
    steps = []
    for offsets in (at.unknowns.offsets, far):
        unknowns = replace(at.unknowns, offsets=offsets)
        system = system_of(replace(at, unknowns=unknowns, trusted=trusted))
        steps.append(np.linalg.solve(system.matrix, system.vector))
    assert steps[0] == pytest.approx(steps[1], abs=1e-12)


def test_a_feature_that_is_not_trusted_still_follows_the_views(exact) -> None:
    trusted = exact.trusted.copy()
    trusted[0] = False
    near = exact.unknowns.inverse_depth.copy()
    near[0] *= 1.02
    at = replace(exact, trusted=trusted, unknowns=replace(exact.unknowns, inverse_depth=near))
    system = system_of(at)
    step = -np.linalg.solve(system.matrix, system.vector)
    back = near[0] + system.features(step)[2, 0]
    assert back == pytest.approx(exact.unknowns.inverse_depth[0], rel=2e-3)


def test_far_from_the_best_unknowns_the_bound_for_outliers_is_wider(exact) -> None:
    at = moved(exact)
    wide = replace(at, widening=100.0)
    assert (wide.weight >= at.weight).all()
    assert wide.weight.sum() > at.weight.sum()


def test_a_view_of_nothing_leaves_the_equations_regular(exact) -> None:
    seen = exact.window.seen.copy()
    seen[2] = False
    geometry = Geometry(replace(exact, window=replace(exact.window, seen=seen)))
    assert (np.diag(geometry.system.matrix) > 0.0).all()
    assert np.isfinite(geometry.root).all()
