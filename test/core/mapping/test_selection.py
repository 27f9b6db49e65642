"""Selection: keyframes are well spread, and what is too much is let go."""

from dataclasses import replace

from map_study import (
    map_after_drive,
    StudySettings,
    StudyTrial,
    trial,
)
import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.fitting import (
    CHANCE,
    NOTHING,
    Shrinkage,
)
from visual_servo_epipolar.core.mapping.keyframe_map import (
    is_keyframe,
    kept_features,
    KeyframeMap,
    most_crowded,
    NEW_SHARE,
    with_keyframe,
)
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import (
    differ_in_place,
    FeatureObservations,
    MapSettings,
)

SETTINGS = MapSettings()


def test_depth_is_the_median_one(exact) -> None:
    expected = float(np.median(1.0 / exact.unknowns.inverse_depth))
    assert Geometry(exact).depth == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ('apart', 'seen', 'new', 'expected'),
    [
        (0.9, 40, 0.0, False),
        (1.1, 40, 0.0, True),
        (0.0, 100, 0.5 * NEW_SHARE, False),
        (0.0, 100, 1.1 * NEW_SHARE, True),
        (9.0, 7, 1.0, False),  # of hardly anything
    ],
)
def test_a_view_from_elsewhere_or_of_other_features_is_a_keyframe(
    exact, apart: float, seen: int, new: float, expected: bool
) -> None:
    geometry, pose = Geometry(exact), exact.unknowns.views[0].copy()
    pose[1] -= apart * SETTINGS.keyframe_spacing * geometry.depth
    found = is_keyframe(geometry, pose, observations=seen, new=int(seen * new), settings=SETTINGS)
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


def test_a_keyframe_that_tells_the_noise_leaves_the_rays_of_the_photograph(drive, memory) -> None:
    before, noisier = memory.geometry, drive.observations(14)
    noisier = replace(noisier, noise=3.0 * noisier.noise)
    place, pose = np.zeros(2), drive.views[14]
    after = with_keyframe(before, noisier, place, pose, replace(SETTINGS, keyframes=99))
    count = len(before.window.ids)
    rays = after.structure.rays[:, :count]
    assert (after.window.photograph_noise[:count] > before.window.photograph_noise).any()
    assert rays == pytest.approx(before.evaluation.structure.rays, abs=1e-12)


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


NEAR = [[0.002, -0.01 + 0.0004 * k, 0.001] for k in range(25)]  # right, ahead [m], heading [rad]
SHIFT_PX, NOISE_PX = 0.2, 0.03  # of a feature, from afar in all views and in each view anew


def drive_to(settings: StudySettings, seed: int) -> StudyTrial:
    """Return a drive that ends with many views near the goal."""
    usual = trial(settings, seed)
    return trial(settings, seed, np.vstack([usual.views[:-1, :3], NEAR]))


def seen_otherwise_from_afar(seed: int) -> StudyTrial:
    """Return a drive with features beside their places in all views but those near the goal."""
    settings = StudySettings(noise=NOISE_PX, wrong=0.0)
    drive = drive_to(settings, seed)
    shift = SHIFT_PX * np.random.default_rng(seed).normal(size=drive.pixels.shape[1:])
    pixels = drive.pixels.copy()
    pixels[1 : -len(NEAR)] += shift
    told = replace(settings, noise=SHIFT_PX)
    return replace(drive, settings=told, pixels=pixels)


def at_the_goal(drive: StudyTrial) -> tuple[KeyframeMap, list[MapLocalization]]:
    """Return the memory at the end, and what it said of the views near the goal."""
    first = len(drive.views) - len(NEAR)
    memory, said = map_after_drive(replace(drive, views=drive.views[: first + 1])), []
    for k in range(first, len(drive.views)):
        observations = drive.observations(k)
        # Of all features the corrections look like no motion; of those in view by then they do.
        observations = observations.take(observations.ids % 3 == 0)
        memory, one = memory.after(observations, drive.motion(k))
        said.append(one)
    return memory, said


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
def test_noise_withdraws_nothing(seed) -> None:
    memory, _ = at_the_goal(drive_to(StudySettings(), seed))
    assert 0.0 <= memory.shrinkage.share < CHANCE
    assert memory.shrinkage.withdrawn == 0.0


def test_what_is_seen_otherwise_from_afar_is_withdrawn_near_the_photograph() -> None:
    errors = []
    for seed in range(1, 5):
        drive = seen_otherwise_from_afar(seed)
        memory, said = at_the_goal(drive)
        assert memory.shrinkage.withdrawn > 0.9
        errors.append(np.mean([one.pose[0] for one in said[-10:]]) - drive.views[-1, 0])
    # Who believes the views from afar ends 1.1 mm aside.
    assert np.sqrt(np.mean(np.square(errors))) < 0.5e-3


def test_far_from_the_goal_nothing_is_known_of_it() -> None:
    drive = seen_otherwise_from_afar(1)
    memory, _ = at_the_goal(drive)
    assert memory.shrinkage.share > CHANCE
    afar, _ = memory.after(drive.observations(0), drive.motion(0))
    assert afar.shrinkage.withdrawn == NOTHING.withdrawn == 0.0


@pytest.mark.parametrize(
    ('share', 'withdrawn'), [(0.0, 0.0), (CHANCE, 0.0), (0.5, 1.0), (1.0, 1.0)]
)
def test_small_shares_are_chance_and_large_ones_the_whole(share, withdrawn) -> None:
    assert Shrinkage(share).withdrawn == pytest.approx(withdrawn)


def shuffled(view: FeatureObservations) -> FeatureObservations:
    order = np.random.default_rng(1).permutation(len(view))
    return FeatureObservations(
        view.ids[order], view.current[order], view.desired[order], view.noise[order]
    )


@pytest.mark.parametrize(('first', 'other', 'expected'), [(2, 2, False), (2, 9, True)])
def test_the_order_of_features_does_not_matter(drive, first, other, expected) -> None:
    last, now = drive.observations(first), drive.observations(other)
    assert differ_in_place(last, now) is expected
    assert differ_in_place(last, shuffled(now)) is expected
    assert differ_in_place(shuffled(last), now) is expected


def test_views_that_share_too_little_differ(drive) -> None:
    view = drive.observations(2)
    few = view.take(np.arange(len(view)) < 2)
    assert differ_in_place(few, few) is True
    assert differ_in_place(view, few) is True
