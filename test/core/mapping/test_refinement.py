"""Refinement: it reaches the truth from afar, finds wrong matches, and factors tell their part."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING
from visual_servo_epipolar.core.mapping import projection
from visual_servo_epipolar.core.mapping.factors import factors_of
from visual_servo_epipolar.core.mapping.refinement import (
    Evaluation,
    FEW_VIEWS,
    Geometry,
    judge_matches,
    NEAREST,
    OUTLIER,
    refine,
    RETURN,
    robust_cost,
    robust_weight,
    system_of,
    WRONG_SHARE,
)
from visual_servo_epipolar.core.mapping.window import (
    EMPTY,
    FeatureObservations,
    MapSettings,
    tangent_basis_of,
    Unknowns,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude


def disturbed(exact: Evaluation) -> Evaluation:
    """Return the evaluation centimetres and a tenth of all depths off."""
    rng = np.random.default_rng(7)
    at = exact.unknowns
    places = rng.normal(size=(len(at.views), 5)) * [0.03, 0.05, 0.005, 0.002, 0.002]
    near = at.inverse_depth * (1.0 + 0.1 * rng.normal(size=len(at.inverse_depth)))
    unknowns = Unknowns(at.views + places, at.shared, at.offsets, near)
    return replace(exact, unknowns=unknowns)


def test_it_reaches_the_truth_from_afar(exact) -> None:
    geometry = refine(disturbed(exact), 20, 1e-3)
    assert geometry.converged
    assert geometry.unknowns.views[:, :3] == pytest.approx(exact.unknowns.views[:, :3], abs=2e-3)
    assert geometry.noise_ratio < 0.05


def test_a_step_that_gains_nothing_is_not_taken(exact) -> None:
    assert refine(exact, 5).evaluation.cost <= exact.cost
    start = disturbed(exact)
    system = system_of(start)
    uphill = system._replace(vector=-system.vector, gradient=-system.gradient)
    end = refine(start, 1, 1e-4, uphill)
    assert end.unknowns is start.unknowns
    assert end.damping > 1e-4
    assert not end.converged


def test_residuals_are_what_noise_makes_them(memory) -> None:
    assert memory.geometry.noise_ratio == pytest.approx(1.0, abs=0.08)


def with_outliers(exact: Evaluation, share: float) -> Evaluation:
    """Return the evaluation with observations of the first feature taken elsewhere."""
    views = np.flatnonzero(exact.window.seen[:, 0])
    count = int(np.ceil(share * len(views)))
    tangent_basis = exact.window.tangent_basis.copy()
    tangent_basis[views[:count], :, :, 0] = exact.window.tangent_basis[views[:count], :, :, 1]
    return replace(exact, window=replace(exact.window, tangent_basis=tangent_basis))


def test_a_feature_is_wrong_where_too_many_of_its_sightings_are(exact) -> None:
    assert not judge_matches(with_outliers(exact, WRONG_SHARE + 0.1)).trusted[0]
    assert judge_matches(with_outliers(exact, WRONG_SHARE - 0.1)).trusted.all()


def test_a_feature_is_wrong_where_the_photograph_shows_it_elsewhere(exact) -> None:
    offsets = exact.unknowns.offsets.copy()
    offsets[0, :2] = np.sqrt(CONTRADICTING) * np.array([1.05, 0.95])
    at = replace(exact, unknowns=replace(exact.unknowns, offsets=offsets))
    tangent_basis = np.where(exact.window.seen[:, None, None], exact.window.tangent_basis, 0.0)
    flat = replace(at, window=replace(at.window, tangent_basis=1e-3 * tangent_basis))
    assert judge_matches(flat).trusted[:3].tolist() == [False, True, True]


def test_a_feature_right_before_the_camera_is_wrong(exact) -> None:
    """Seen from one place it may be anywhere; it would tell the pose better than all others."""
    near = exact.unknowns.inverse_depth.copy()
    near[0] = 1.1 * NEAREST * np.median(near)
    tangent_basis = np.zeros_like(exact.window.tangent_basis)  # what contradicts it is not seen
    seen = exact.window.seen.copy()
    seen[FEW_VIEWS:, 0] = False
    at = replace(
        exact,
        window=replace(exact.window, tangent_basis=tangent_basis, seen=seen),
        unknowns=replace(exact.unknowns, inverse_depth=near),
    )
    assert judge_matches(at).trusted[:2].tolist() == [False, True]
    often = replace(at, window=replace(at.window, seen=np.ones_like(seen)))
    assert judge_matches(often).trusted[0]  # before a scene far away some features are near
    near[0] /= 1.2
    assert judge_matches(replace(at, unknowns=replace(at.unknowns, inverse_depth=near))).trusted[0]


def test_what_was_wrong_must_be_well_within_the_bound_to_count_again(exact) -> None:
    trusted = exact.trusted.copy()
    trusted[0] = False
    nearly = replace(with_outliers(exact, WRONG_SHARE - 0.1), trusted=trusted)
    assert RETURN * WRONG_SHARE < WRONG_SHARE - 0.1
    assert not judge_matches(nearly).trusted[0]
    assert judge_matches(replace(exact, trusted=trusted)).trusted[0]


def test_a_feature_behind_the_cameras_is_wrong_however_well_it_fits(exact) -> None:
    near, tangent_basis = exact.unknowns.inverse_depth.copy(), exact.window.tangent_basis.copy()
    near[[0, 1]] = [-near[0], -1e-9]
    flipped = replace(exact, unknowns=replace(exact.unknowns, inverse_depth=near))
    shown = flipped.projection.points / flipped.projection.length[:, None]
    count = len(near)
    for k in range(len(exact.window)):
        tangent_basis[k] = tangent_basis_of(shown[k].T, np.full(count, 3e-4))
    window = replace(exact.window, tangent_basis=tangent_basis, rays=shown)
    at = replace(flipped, window=window)
    assert at.squares[window.seen].max() < 1e-6
    assert judge_matches(at).trusted[:3].tolist() == [False, True, True]


RAYS = np.random.default_rng(1).normal(size=(40, 3))
RAYS /= np.linalg.norm(RAYS, axis=1)[:, None]
DEPTHS = np.random.default_rng(2).uniform(0.1, 1.0, 9)  # inverse
STEP = 1e-6
ANGLE = st.floats(-0.5, 0.5)
VIEWS = st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, 0.5), st.floats(-3.0, 3.0), ANGLE, ANGLE)


@given(view=VIEWS, tilt=ANGLE, roll=ANGLE, lens=st.floats(-0.2, 0.2))
@settings(max_examples=25, deadline=None)
def test_derivatives_are_those_of_the_residuals(view, tilt, roll, lens) -> None:
    photograph, offsets = RAYS[:9], RAYS[9:18, :2].T
    # A thousandth of a radian a deviation.
    tangents = tangent_basis_of(photograph, np.full(9, 1e3))
    at = Unknowns(np.array([view]), np.array([tilt, roll, lens, 0.0, 0.0]), offsets, DEPTHS)
    tangent_basis = tangent_basis_of(photograph, np.full(9, 1.0))[None]

    def residuals(unknowns):
        structure = projection.structure_of(photograph, tangents, unknowns)
        return projection.project(structure, unknowns.views, tangent_basis).residuals

    structure = projection.structure_of(photograph, tangents, at)
    here = projection.project(structure, at.views, tangent_basis)
    told = projection.slopes(structure, at.views, tangent_basis, here)
    axes, pair = np.eye(5), np.eye(2)
    others = [replace(at, views=at.views + STEP * axis) for axis in axes]
    others += [replace(at, offsets=at.offsets + STEP * axis[:, None]) for axis in pair]
    others += [replace(at, inverse_depth=at.inverse_depth + STEP)]
    others += [replace(at, shared=at.shared + STEP * np.eye(5)[j]) for j in range(3)]
    for j, other in enumerate(others):
        expected = (residuals(other) - here.residuals) / STEP
        tolerance = 1e-4 * (1.0 + np.abs(1.0 / here.length).max() ** 2)
        assert told[:, j] == pytest.approx(expected, abs=tolerance)


def test_what_would_lie_behind_its_ray_is_far_off(exact) -> None:
    window = exact.window
    ahead = projection.squares_of(exact.projection, window.rays)[window.seen]
    behind = projection.squares_of(exact.projection, -window.rays)[window.seen]
    assert ahead.max() < 1e-6
    assert behind.min() == projection.OPPOSITE


def observations(ids) -> FeatureObservations:
    """Return observations of rays that tell their ids."""
    ids = np.array(ids, np.int64)
    return FeatureObservations(ids, RAYS[ids], RAYS[ids][:, ::-1], np.full((len(ids), 2), 1e-3))


def test_the_noise_of_the_photograph_is_the_mean_of_what_views_show_of_it() -> None:
    window, first = EMPTY, observations([1, 2])
    for noise in (3e-3, 1e-3, 1e-3):
        window = window.with_view(replace(first, noise=np.full((2, 2), noise)), np.zeros(2))
    window = window.with_view(observations([2, 3]), np.zeros(2))
    squares = 1e-6 * np.array([11.0 / 3.0, 12.0 / 4.0, 1.0])
    assert window.photograph_noise == pytest.approx(np.sqrt(squares))


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
