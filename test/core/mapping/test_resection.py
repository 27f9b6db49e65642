"""Resection: as sure as all views together, found from afar, and own noise told apart."""

from dataclasses import replace

from map_bound import bound
from map_study import StudyTrial
import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.fitting import (
    Anchors,
    anchors_of,
    fit_pose,
    MatchedFeatures,
    nearest_view,
    NOTHING,
    resect,
)
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import tangent_basis_of


def seen_by(drive: StudyTrial, geometry: Geometry, k: int) -> tuple[Anchors, MatchedFeatures]:
    """Return what view ``k`` shows of a geometry, and the anchors of it."""
    observations = drive.observations(k)
    rows = geometry.window.rows_of(observations.ids)
    kept = (rows >= 0) & geometry.trusted[rows]
    tangent_basis = tangent_basis_of(observations.current[kept], observations.noise[kept, 0])
    seen = MatchedFeatures(rows[kept], observations.current[kept].T, tangent_basis)
    return anchors_of(geometry).of(seen.rows), seen


@pytest.fixture(scope='module')
def last(exact_drive, exact):
    """Return geometry, anchors and observations of an exact view near the goal."""
    geometry = Geometry(exact)
    return geometry, *seen_by(exact_drive, geometry, 14)


def test_it_is_as_sure_as_all_views_together(exact_drive, last) -> None:
    geometry, anchors, seen = last
    fit = fit_pose(anchors, seen, exact_drive.views[14])
    covariance = resect(geometry, anchors, seen, fit, NOTHING)[0].covariance
    least = bound(exact_drive)
    # Noise is taken to be as large along a ray's meridian as across: that costs a few percent.
    assert np.sqrt(np.diag(covariance) / np.diag(least)) == pytest.approx(1.0, abs=0.06)


def test_features_as_if_independent_would_be_too_sure(exact_drive, last) -> None:
    # What keyframes have in common, first of all the scale, does not average out over features.
    geometry, anchors, seen = last
    far = np.array([0.3, -2.5, 0.0, 0.0, 0.0])
    fit = fit_pose(anchors, seen, exact_drive.views[14])._replace(pose=far)
    assert resect(geometry, anchors, seen, fit, NOTHING)[0].covariance[1, 1] > (0.04 * 2.5) ** 2


@pytest.mark.parametrize('times', [1.0, 2.0])  # as large as expected of the noise
def test_own_noise_is_what_views_draw_anew(exact_drive, last, times: float) -> None:
    geometry, anchors, seen = last
    rng = np.random.default_rng(3)
    poses, own = [], []
    across = seen.tangent_basis / (seen.tangent_basis**2).sum(1)[:, None]
    for _ in range(200):
        drawn = times * rng.normal(size=(2, 1, seen.rays.shape[1]))
        rays = seen.rays + (across * drawn).sum(0)
        rays /= np.linalg.norm(rays, axis=0)
        noise = 1.0 / np.sqrt((seen.tangent_basis[0] ** 2).sum(0))
        noisy = replace(seen, rays=rays, tangent_basis=tangent_basis_of(rays.T, noise))
        fit = fit_pose(anchors, noisy, exact_drive.views[14])
        found, _ = resect(geometry, anchors, noisy, fit, NOTHING)
        poses.append(found.pose)
        own.append(np.diag(found.own))
    ratio = np.std(poses, axis=0) / np.sqrt(np.mean(own, axis=0))
    # The errors of the structure are not drawn, and count for as much more as views are noisier.
    assert ratio[:3] == pytest.approx(1.0, abs=0.25 if times > 1.0 else 0.15)


@pytest.mark.parametrize('turn', [-0.6, 0.5, 2.5])
def test_after_a_push_it_starts_at_the_keyframe_most_alike(exact_drive, exact, last, turn) -> None:
    _, anchors, seen = last
    lost = exact.unknowns.views + [0.2, 0.3, turn, 0.0, 0.0]
    start = nearest_view(anchors, seen, lost)
    assert start[2] == pytest.approx(exact_drive.views[14, 2], abs=0.1)
    fit = fit_pose(anchors, seen, start)
    assert fit.pose == pytest.approx(exact_drive.views[14], abs=1e-3)


def test_it_finds_the_way_from_afar(exact_drive, last) -> None:
    _, anchors, seen = last
    start = exact_drive.views[14] + [0.5, -0.9, 0.45, 0.05, 0.1]
    assert fit_pose(anchors, seen, start).pose == pytest.approx(exact_drive.views[14], abs=1e-4)


def test_what_the_floor_can_do_bounds_what_is_not_known_of_the_attitude(last) -> None:
    geometry, anchors, seen = last
    rows = np.arange(3)  # hardly anything
    few = MatchedFeatures(
        seen.rows[rows], seen.rays[:, rows], seen.tangent_basis[..., rows] * 1e-3
    )
    chosen = anchors.of(rows)
    fit = fit_pose(chosen, few, geometry.unknowns.views[-1])
    deviations = np.sqrt(np.diag(resect(geometry, chosen, few, fit, NOTHING)[0].covariance)[3:])
    assert deviations == pytest.approx(anchors.deviation, rel=0.05)


def test_wrong_sightings_do_not_pull(exact_drive, last) -> None:
    geometry, anchors, seen = last
    rays, tangent_basis = seen.rays.copy(), seen.tangent_basis.copy()
    rays[:, :9], tangent_basis[..., :9] = seen.rays[:, 9:18], seen.tangent_basis[..., 9:18]
    wrong = replace(seen, rays=rays, tangent_basis=tangent_basis)
    found, _ = resect(
        geometry, anchors, wrong, fit_pose(anchors, wrong, exact_drive.views[13]), NOTHING
    )
    assert not found.inliers[:9].any()
    assert found.inliers[9:].all()
    deviations = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.pose - exact_drive.views[14]) < 0.2 * deviations)[:3].all()
