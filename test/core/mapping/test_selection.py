"""Selection: keyframes are well spread, and what is too much is let go."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.feature_observations import MapSettings
from visual_servo_epipolar.core.mapping.selection import (
    is_keyframe,
    kept_features,
    most_crowded,
    NEW_SHARE,
)

SETTINGS = MapSettings()


def test_depth_is_the_median_one(exact) -> None:
    expected = float(np.median(1.0 / exact.unknowns.inverse_depth))
    assert Geometry(exact).depth == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(('apart', 'expected'), [(0.9, False), (1.1, True)])
def test_a_view_from_elsewhere_is_a_keyframe(exact, apart: float, expected: bool) -> None:
    geometry = Geometry(exact)
    pose = exact.unknowns.views[0].copy()
    pose[1] -= apart * SETTINGS.keyframe_spacing * geometry.depth
    assert is_keyframe(geometry, pose, observations=40, new=0, settings=SETTINGS) is expected


@pytest.mark.parametrize(('share', 'expected'), [(0.5, False), (1.1, True)])
def test_a_view_of_other_features_is_one(exact, share: float, expected: bool) -> None:
    pose, new = exact.unknowns.views[3], int(100 * share * NEW_SHARE)
    found = is_keyframe(Geometry(exact), pose, observations=100, new=new, settings=SETTINGS)
    assert found is expected


def test_features_that_only_show_near_the_photograph_make_none(exact) -> None:
    """They have no depth there: a wrong match may be right before the camera, and outweigh all."""
    near = 0.9 * SETTINGS.keyframe_spacing * Geometry(exact).depth
    views = exact.unknowns.views.copy()
    views[3, :2] = 0.0, -near
    geometry = Geometry(replace(exact, unknowns=replace(exact.unknowns, views=views)))
    assert not is_keyframe(geometry, views[3], observations=60, new=60, settings=SETTINGS)
    views[3, 1] = -2.0 * near
    assert is_keyframe(geometry, views[3], observations=60, new=60, settings=SETTINGS)


def test_new_features_without_room_make_none(exact) -> None:
    """Each image would become a keyframe, and its features be let go with the next."""
    pose, count = exact.unknowns.views[3], len(exact.window.ids)
    crammed = replace(SETTINGS, features=count)
    assert not is_keyframe(Geometry(exact), pose, observations=60, new=60, settings=crammed)
    roomy = replace(SETTINGS, features=count + 60)
    assert is_keyframe(Geometry(exact), pose, observations=60, new=60, settings=roomy)


def test_a_view_of_hardly_anything_is_none(exact) -> None:
    pose = exact.unknowns.views[0] - [0.0, 5.0, 0.0, 0.0, 0.0]
    assert not is_keyframe(Geometry(exact), pose, observations=7, new=7, settings=SETTINGS)


def test_the_keyframe_in_the_crowd_goes_and_the_newest_stays() -> None:
    places = np.array([[0.0, -4.0], [0.0, -3.0], [0.0, -2.9], [0.0, -2.0], [0.0, -1.99]])
    everything = np.ones((5, 10), bool)
    assert most_crowded(places, everything, 5.0) == 3
    assert most_crowded(places[:4], everything[:4], 5.0) in (1, 2)
    between = np.array([[0.0, -4.0], [0.0, -3.0], [0.0, -2.0], [0.0, -1.98], [0.0, -1.99]])
    assert most_crowded(between, everything, 5.0) in (2, 3)


def test_of_two_alike_the_one_with_fewer_features_goes() -> None:
    places = np.array([[0.0, -4.0], [0.0, -3.0], [0.0, -2.9], [0.0, -1.0]])
    seen = np.ones((4, 10), bool)
    seen[2, 4:] = False
    assert most_crowded(places, seen, 5.0) == 2
    assert most_crowded(places, seen[[0, 2, 1, 3]], 5.0) == 1


def test_features_that_no_keyframe_shows_are_let_go(exact) -> None:
    seen = exact.window.seen.copy()
    seen[:, 3] = False
    kept = kept_features(replace(exact.window, seen=seen), exact.trusted, 120)
    assert np.flatnonzero(~kept).tolist() == [3]


def test_the_most_seen_features_are_kept_and_wrong_ones_go_first(exact) -> None:
    seen = np.ones(exact.window.seen.shape, bool)
    seen[1:, 5] = False
    trusted = exact.trusted.copy()
    trusted[7] = False
    count = len(trusted)
    kept = kept_features(replace(exact.window, seen=seen), trusted, count - 2)
    assert np.flatnonzero(~kept).tolist() == [5, 7]
    # Of those alike, the newest.
    assert not kept_features(replace(exact.window, seen=seen), trusted, count - 3)[-1]
