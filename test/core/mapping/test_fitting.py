"""Fitting: correspondences are looked up once for views of the same features, anew for others."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.feature_observations import tangent_basis_of
from visual_servo_epipolar.core.mapping.fitting import (
    anchors_of,
    correspondences_of,
    errors_of,
    fit_pose,
    MatchedFeatures,
)
from visual_servo_epipolar.core.mapping.resection import NOTHING, resect


def test_they_are_of_these_features_and_of_this_geometry(exact, exact_drive) -> None:
    geometry, ids = Geometry(exact), exact_drive.observations(3).ids
    found = correspondences_of(geometry, ids)
    assert found.are_of(geometry, ids.copy())
    assert not found.are_of(geometry, ids[::-1])
    assert not found.are_of(geometry, ids[1:])
    assert not found.are_of(Geometry(exact), ids)


def test_a_view_of_the_same_features_says_what_it_would_alone(drive, memory) -> None:
    for k in (12, 13):
        observations = drive.observations(k)
        before, _ = memory.after(observations, learns=False)
        again, said = before.after(observations, learns=False)
        assert again.correspondences is before.correspondences
        alone = replace(before, correspondences=None).after(observations, learns=False)[1]
        assert said.pose.tolist() == alone.pose.tolist()


def view_of(drive, geometry: Geometry, k: int) -> MatchedFeatures:
    """Return what view ``k`` shows of features that are trusted."""
    observations = drive.observations(k)
    found = correspondences_of(geometry, observations.ids)
    rays = observations.current[found.known]
    return MatchedFeatures(
        found.chosen, rays.T, tangent_basis_of(rays, observations.noise[found.known, 0])
    )


@pytest.mark.parametrize('k', [2, 8, 14])
def test_errors_that_show_nowhere_are_left_out_of_a_view(drive, memory, k: int) -> None:
    geometry = memory.geometry
    seen = view_of(drive, geometry, k)
    anchors = anchors_of(geometry).of(seen.rows)
    fit = fit_pose(anchors, seen, drive.views[k])
    some = errors_of(geometry, seen.rows)
    every = some._replace(
        shared=np.concatenate(
            [
                geometry.feature_roots[seen.rows],
                np.broadcast_to(geometry.root[-5:-2], (len(seen.rows), 3, len(geometry.root))),
            ],
            axis=1,
        ),
        attitude=geometry.root[-2:] / geometry.evaluation.factors.mount.jitter,
    )
    assert some.shared.shape[2] < every.shared.shape[2]
    found, whole = (
        resect(geometry, anchors, seen, fit, NOTHING, errors=errors) for errors in (some, every)
    )
    own = np.sqrt(np.diag(whole.own))
    assert (np.abs(found.pose - whole.pose) < 0.01 * own).all()
    assert np.diag(found.covariance) == pytest.approx(np.diag(whole.covariance), rel=1e-3)


def test_slopes_of_a_short_last_step_are_good_enough(drive, memory) -> None:
    geometry = memory.geometry
    seen = view_of(drive, geometry, 13)
    anchors = anchors_of(geometry).of(seen.rows)
    begun = fit_pose(anchors, seen, drive.views[13])
    fit = fit_pose(anchors, seen, begun.pose)
    assert fit.slopes is not None
    near = resect(geometry, anchors, seen, fit, NOTHING)
    anew = resect(geometry, anchors, seen, fit._replace(slopes=None), NOTHING)
    assert near.pose == pytest.approx(anew.pose, abs=0.01 * np.sqrt(anew.own[0, 0]))


def test_after_a_longer_step_slopes_are_taken_anew(drive, memory) -> None:
    geometry = memory.geometry
    seen = view_of(drive, geometry, 13)
    anchors = anchors_of(geometry).of(seen.rows)
    begun = fit_pose(anchors, seen, drive.views[13]).pose
    far = [0.0, 0.0, 7e-4, 0.0, 0.0]  # twenty deviations: slopes serve to get back, no more
    assert fit_pose(anchors, seen, begun + far).slopes is None
