"""Refinement: it reaches the truth from afar, and finds wrong matches and no others."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.adjustment.equations import Evaluation, system_of
from visual_servo_epipolar.core.mapping.adjustment.refinement import (
    FEW_VIEWS,
    judge_matches,
    NEAREST,
    refine,
    RETURN,
    WRONG_OFFSET,
    WRONG_SHARE,
)
from visual_servo_epipolar.core.mapping.adjustment.window import Unknowns
from visual_servo_epipolar.core.mapping.feature_observations import tangent_basis_of


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


def test_steps_are_counted_not_timed(exact) -> None:
    start = disturbed(exact)
    ends = [refine(start, steps, 1e-3) for steps in range(4)]
    assert ends[0].unknowns.views[:, 2:] == pytest.approx(start.unknowns.views[:, 2:], abs=0.0)
    costs = [replace(end.evaluation, trusted=start.trusted).cost for end in ends]
    assert costs == sorted(costs, reverse=True)
    assert costs[1] < 0.5 * costs[0]
    assert costs[2] < costs[1]
    assert not ends[1].converged


def test_wrong_matches_are_found_and_no_others(drive, memory) -> None:
    wrong = np.flatnonzero(~drive.right.any(0))
    geometry = memory.geometry
    assert sorted(geometry.window.ids[~geometry.trusted]) == sorted(wrong)


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
    offsets[0, :2] = np.sqrt(WRONG_OFFSET) * np.array([1.05, 0.95])
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
    assert judge_matches(often).trusted[
        0
    ]  # before a scene that is far away some features are near
    near[0] /= 1.2
    assert judge_matches(replace(at, unknowns=replace(at.unknowns, inverse_depth=near))).trusted[0]


def test_what_was_wrong_must_be_well_within_the_bound_to_count_again(exact) -> None:
    trusted = exact.trusted.copy()
    trusted[0] = False
    nearly = replace(with_outliers(exact, WRONG_SHARE - 0.1), trusted=trusted)
    assert RETURN * WRONG_SHARE < WRONG_SHARE - 0.1
    assert not judge_matches(nearly).trusted[0]
    assert judge_matches(replace(exact, trusted=trusted)).trusted[0]


def test_root_and_feature_covariance_are_those_of_the_equations(memory) -> None:
    geometry = memory.geometry
    covariance = np.linalg.inv(geometry.system.matrix)
    scale = np.sqrt(np.diag(covariance))
    root = geometry.root / scale[:, None]
    assert root @ root.T == pytest.approx(covariance / np.outer(scale, scale), abs=1e-5)
    n = 4
    errors = geometry.system.roots[n] @ geometry.system.coupled[n]
    own = geometry.system.roots[n] @ geometry.system.roots[n].T
    expected = own + errors @ covariance @ errors.T
    assert geometry.feature_covariance[..., n] == pytest.approx(expected, rel=1e-4, abs=1e-9)


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
