"""Sightings and window: features come and go, and bad input is refused in one line."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.adjustment.window import EMPTY, Unknowns
from visual_servo_epipolar.core.mapping.feature_observations import (
    FeatureObservations,
    tangent_basis_of,
)

RAYS = np.random.default_rng(1).normal(size=(40, 3))
RAYS /= np.linalg.norm(RAYS, axis=1)[:, None]
IDS = st.lists(st.integers(0, 39), max_size=12, unique=True)


def observations(ids) -> FeatureObservations:
    """Return observations of rays that tell their ids."""
    ids = np.array(ids, np.int64)
    return FeatureObservations(ids, RAYS[ids], RAYS[ids][:, ::-1], np.full((len(ids), 2), 1e-3))


@given(views=st.lists(IDS, min_size=1, max_size=5))
@settings(max_examples=40, deadline=None)
def test_every_sighting_stands_where_its_feature_does(views) -> None:
    window = EMPTY
    for ids in views:
        window = window.with_view(observations(ids), np.zeros(2))
    assert len(window) == len(views)
    assert sorted(window.ids) == sorted(set().union(*views))
    for k, ids in enumerate(views):
        assert set(window.ids[window.seen[k]]) == set(ids)
        shown = window.seen[k]
        assert window.rays[k][:, shown].T == pytest.approx(RAYS[window.ids[shown]])
    assert window.photograph == pytest.approx(RAYS[window.ids][:, ::-1])
    kept = window.ids % 2 == 0
    fewer = window.of_features(kept).without_view(0)
    assert fewer.seen.tolist() == window.seen[1:, kept].tolist()


@given(ids=IDS, others=IDS)
@settings(max_examples=40, deadline=None)
def test_features_are_found_by_their_ids_and_others_are_not(ids, others) -> None:
    window = EMPTY.with_view(observations(ids), np.zeros(2))
    rows = window.rows_of(np.array(others, np.int64))
    for row, other in zip(rows.tolist(), others, strict=True):
        assert row == (list(window.ids).index(other) if other in ids else -1)


def test_sides_are_across_and_as_long_as_a_deviation_is_short() -> None:
    tangent_basis = tangent_basis_of(RAYS, np.full(40, 0.01))
    assert np.einsum('ajn,nj->an', tangent_basis, RAYS) == pytest.approx(0.0, abs=1e-12)
    assert np.sqrt((tangent_basis**2).sum(1)) == pytest.approx(100.0)
    assert (tangent_basis[0] * tangent_basis[1]).sum(0) == pytest.approx(0.0, abs=1e-8)


def test_a_geometry_is_scaled_as_a_whole() -> None:
    views = np.array([[1.0, -2.0, 0.1, 0.2, 0.3]])
    unknowns = Unknowns(views, np.zeros(4), np.zeros((2, 3)), np.ones(3)).scaled(2.0)
    assert unknowns.views.tolist() == [[2.0, -4.0, 0.1, 0.2, 0.3]]
    assert unknowns.inverse_depth.tolist() == [0.5, 0.5, 0.5]


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'current': RAYS[:2]}, r'current must have shape \(3, 3\) to match ids, got \(2, 3\)'),
        ({'desired': RAYS[:3] * [1.0, np.nan, 1.0]}, 'desired must be finite, got 3 rows'),
        ({'current': RAYS[:3] * np.nan}, 'current must be finite, got 3 rows'),
        ({'noise': np.zeros((3, 2))}, 'noise must be positive, got 0'),
        ({'ids': np.array([1, 2, 2])}, 'ids must differ, got 3 of which 2 do'),
    ],
)
def test_bad_sightings_are_refused(change, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(observations([1, 2, 3]), **change)
