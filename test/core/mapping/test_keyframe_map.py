"""View memory: it begins, grows, forgets and finds again, within bounds and to the last bit."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from map_study import (
    map_after_drive,
    mapped,
    StudySettings,
    StudyTrial,
    trial,
    two_views,
    TwoViewBearings,
)
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.mapping import keyframe_map
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap, MOST_REFUSED
from visual_servo_epipolar.core.mapping.localization import MapLocalization, seen_rays
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import (
    FeatureObservations,
    LENS,
    MapSettings,
    SHARED,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude

DEVIATIONS = 4.0


def near_truth(said: MapLocalization | None, truth: np.ndarray, scale: float = 1.0) -> bool:
    """Whether x, y and heading are as near to the truth as they are said to be."""
    assert said is not None
    error = (said.pose - truth)[:3] - [*(truth[:2] * (scale - 1.0)), 0.0]
    return bool((np.abs(error) < DEVIATIONS * np.sqrt(np.diag(said.covariance)[:3])).all())


@pytest.mark.parametrize('ratio', [0.95, 1.03])
def test_a_focal_length_that_is_wrong_is_found_out_on_the_way(drive, ratio) -> None:
    camera = drive.settings.camera
    told = replace(camera, fx=ratio * camera.fx, fy=ratio * camera.fy)
    wrong = replace(drive, settings=replace(drive.settings, camera=told))
    memory = map_after_drive(wrong)
    geometry, last = memory.geometry, len(wrong.views) - 1
    deviation = float(np.linalg.norm(geometry.root[-SHARED + LENS]))
    assert deviation < 0.01
    assert geometry.unknowns.shared[LENS] == pytest.approx(
        -math.log(ratio), abs=DEVIATIONS * deviation
    )
    _, said = memory.after(wrong.observations(last), wrong.motion(last))
    assert near_truth(said, drive.views[last], drive.scale)


def test_what_a_view_shows_is_not_counted_twice(drive, memory) -> None:
    # A view that becomes a keyframe is held against what was known before it.
    far, near = (replace(memory, settings=MapSettings(keyframe_spacing=s)) for s in (9.0, 1e-6))
    keyframe, one = near.after(drive.observations(14))
    same, other = far.after(drive.observations(14))
    keyframe = keyframe.update_map()
    assert keyframe.trial is not None
    assert keyframe.geometry is memory.geometry
    done = keyframe.after(drive.observations(14))[0].update_map()
    assert len(done.window) == min(len(same.window) + 1, 14)
    assert done.trial is None
    assert one.pose.tolist() == other.pose.tolist()
    assert one.covariance.tolist() == other.covariance.tolist()


def test_an_answer_does_not_wait_for_learning_from_a_view(drive, memory, monkeypatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError('the window is refined')

    moved = replace(memory, settings=MapSettings(keyframe_spacing=1e-6))
    with monkeypatch.context() as patch:
        patch.setattr(keyframe_map, 'refine', refuse)
        after, said = moved.after(drive.observations(14))
        assert said is not None
        with pytest.raises(AssertionError, match='is refined'):
            after.update_map()
    assert after.update_map().trial is not None
    assert after.pose.tolist() == said.pose.tolist()  # where the next view is looked for
    late, soon = (each.after(drive.observations(14))[1] for each in (after, after.update_map()))
    assert late.pose.tolist() == soon.pose.tolist()


def test_the_way_is_turned_as_the_camera_was(memory) -> None:
    turned = replace(memory, pose=np.array([0.0, 0.0, 0.5 * math.pi, 0.0, 0.0]))
    nothing = FeatureObservations(*map(np.empty, (0, (0, 3), (0, 3), (0, 2))))
    after, _ = turned.after(nothing, np.array([0.0, 1.0]))
    assert after.place - memory.place == pytest.approx([-1.0, 0.0])  # facing left


def test_a_wrong_match_does_not_count_where_it_happens_to_agree(drive, memory) -> None:
    observations = drive.observations(14)
    _, before = memory.after(observations)
    number = observations.ids[before.inliers][0]
    trusted = memory.geometry.trusted & (memory.window.ids != number)
    evaluation = replace(memory.geometry.evaluation, trusted=trusted)
    _, said = replace(memory, geometry=Geometry(evaluation)).after(observations)
    assert not said.inliers[observations.ids == number].any()
    assert number in said.geometry.wrong


def test_a_geometry_that_keyframes_contradict_again_is_forgotten(drive, memory) -> None:
    """One alone may be a view of who passes by: it is not kept, and all else is."""
    window = memory.window
    louder = replace(window, tangent_basis=5.0 * window.tangent_basis)  # noise was told too small
    evaluation = replace(memory.geometry.evaluation, window=louder)
    deceived = replace(
        memory,
        geometry=Geometry(evaluation),
        settings=MapSettings(keyframe_spacing=1e-6),
    )
    after = deceived
    for refused in range(1, MOST_REFUSED):
        after, _ = after.after(drive.observations(14))
        after, said = after.after(drive.observations(14))  # the other half of the trial
        after = after.update_map()
        assert said is not None
        assert (after.window, after.geometry) == (deceived.window, deceived.geometry)
        assert after.refused == refused
    fits = replace(memory, refused=1, settings=MapSettings(keyframe_spacing=1e-6))
    for _ in range(2):
        fits, _ = fits.after(drive.observations(14))
        after, said = after.after(drive.observations(14))
        after, fits = after.update_map(), fits.update_map()
    assert fits.refused == 0
    assert said is not None
    assert after.geometry is None
    assert len(after.window) == 0


def test_without_any_way_it_is_still_exact_at_the_goal(drive) -> None:
    *_, (_, said) = mapped(replace(drive, scale=math.nan))
    assert math.degrees(abs(said.pose[2] - drive.views[14, 2])) < 0.05
    assert said.pose[0] / said.geometry.depth == pytest.approx(drive.views[14, 0] / 5.5, abs=1e-3)


def test_predicted_rays_are_where_features_are_seen(drive, memory) -> None:
    observations = drive.observations(14)
    _, said = memory.after(observations)
    rows = {number: row for row, number in enumerate(memory.window.ids.tolist())}
    at = [rows[number] for number in observations.ids[said.inliers].tolist()]
    structure = memory.geometry.evaluation.structure
    rays = seen_rays(structure, said.pose)
    angle = np.linalg.norm(rays[at] - observations.current[said.inliers], axis=1)
    assert np.median(angle) < 2.0 * np.median(observations.noise)
    pixels = drive.settings.camera.pixels(rays)
    assert pixels[at] == pytest.approx(drive.pixels[15, observations.ids[said.inliers]], abs=2.0)


@pytest.mark.parametrize('count', [5, 7, 11])
def test_few_features_are_enough_once_they_are_known(drive, memory, count: int) -> None:
    observations = drive.observations(14)
    known = np.flatnonzero(drive.right[14][observations.ids])[:count]
    observations = observations.take(np.isin(np.arange(len(observations)), known))
    _, said = memory.after(observations)
    _, whole = memory.after(drive.observations(14))
    assert near_truth(said, drive.views[14])
    assert said.lateral_deviation > 1.5 * whole.lateral_deviation


def test_too_few_features_or_features_of_elsewhere_tell_no_place(drive, memory) -> None:
    observations = drive.observations(14)
    shuffled = replace(observations, current=np.roll(observations.current, 7, axis=0))
    for view in (observations.take(np.arange(len(observations)) < 4), shuffled):
        after, said = memory.after(view)
        assert said is None
        assert after.geometry is memory.geometry


def test_features_unseen_before_join_and_become_known(drive) -> None:
    late = set(range(0, 60, 3))
    # A scale that is sure leaves what images tell of depths.
    memory = KeyframeMap(drive.mount, MapSettings(scale_deviation=1e-3))
    variance = {}
    for k in range(15):
        observations = drive.observations(k)
        if k < 5:
            observations = observations.take(observations.ids % 3 > 0)
        told = two_views(drive, k).bearings if memory.geometry is None else ()
        geometry = memory.update_map().geometry
        memory, said = memory.after(observations, drive.motion(k), bearings=told)
        variances = [] if said is None else geometry.feature_covariance[2, 2].tolist()
        ids = [] if said is None else geometry.window.ids.tolist()
        variance[k] = dict(zip(ids, variances, strict=True))
    assert not late & set(variance[5])
    new = sorted(late & set(variance[14]) - set(said.geometry.wrong.tolist()))
    assert len(new) > 12
    first = {i: min(k for k in variance if i in variance[k]) for i in new}
    ratios = [variance[14][i] / variance[first[i]][i] for i in new]
    assert np.median(ratios) < 0.55  # every other view becomes a keyframe


def test_it_grows_to_its_bounds_and_no_further(drive) -> None:
    settings = MapSettings(keyframes=5, features=40, keyframe_spacing=1e-4)
    *maps, (memory, said) = mapped(drive, settings)
    assert all(len(each.window) <= 5 and len(each.window.ids) <= 40 for each, _ in maps)
    assert len(memory.window) == 5
    assert near_truth(said, drive.views[14])


def test_a_turn_in_place_tells_no_geometry_and_harms_none() -> None:
    drive = trial(StudySettings(), 3, np.column_stack([np.zeros((9, 2)), np.linspace(0, 0.1, 9)]))
    *_, (memory, said) = mapped(drive)
    assert (memory.geometry, said) == (None, None)


@pytest.mark.parametrize(
    ('place', 'blind'),
    [((0.004, -0.003, 0.2), 0), ((0.3, -0.8, -0.25), 5)],
    ids=['turned at the goal', 'pushed aside, blind'],
)
def test_a_view_from_anywhere_is_found(drive, memory, place, blind) -> None:
    there = trial(drive.settings, 3, np.vstack([drive.views[:, :3], place]))
    nothing = drive.observations(14).take(drive.observations(14).ids < 0)
    for _ in range(blind):
        memory, said = memory.after(nothing)
        assert said is None
    _, said = memory.after(there.observations(15))
    assert near_truth(said, there.views[15])
    assert blind or said.lateral_deviation < 0.003
    lost = replace(memory, pose=np.array([4.0, 9.0, 2.5, 0.4, -0.4]))  # but keyframes are of use
    assert near_truth(lost.after(there.observations(15))[1], there.views[15])


AXIS = np.column_stack([np.zeros(15), [*-np.linspace(3.0, 0.2, 14), -0.01], np.zeros(15)])


@pytest.mark.parametrize(
    ('known', 'places'),
    [({}, AXIS), ({'tilt': 0.2, 'tilt_deviation': 0.26}, None)],
    ids=['on the axis alone', 'a camera that looks down'],
)
def test_any_way_and_mount_will_do(known, places) -> None:
    drive = trial(StudySettings(**known), 3, places)
    _, said = map_after_drive(drive).after(drive.observations(14), drive.motion(14))
    assert near_truth(said, drive.views[14])
    assert said.lateral_deviation < 0.0025
    assert said.pose[3] == pytest.approx(drive.views[14, 3], abs=0.01)


def true_bearings(drive: StudyTrial, k: int) -> TwoViewBearings:
    """Return what two views would tell of view ``k`` at best."""
    x, y, heading = drive.views[k, :3].tolist()
    return TwoViewBearings((Bearings.from_pose(Pose(x, y, heading + 0.5 * math.pi)),))


@pytest.mark.parametrize('wall', [False, True], ids=['room', 'wall'])
def test_of_two_geometries_that_two_views_allow_the_views_choose(wall: bool) -> None:
    drive = trial(StudySettings(wall=wall), 3)

    def both(drive: StudyTrial, k: int) -> TwoViewBearings:
        right = true_bearings(drive, k).bearings[0]
        return TwoViewBearings((Bearings(right.psi + 0.5, right.phi + 0.55), right))

    *_, (memory, said) = mapped(drive, told=both)
    assert near_truth(said, drive.views[14])
    assert memory.geometry.noise_ratio == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize('wall', [True, False])
def test_where_a_wall_has_a_twin_it_waits_for_more_views(wall: bool) -> None:
    """Straight back from 5 cm aside: in the twin the robot is straight before the wall."""
    behind = 0.06 + 0.018 * np.arange(14)
    drive = trial(StudySettings(wall=wall), 2, np.array([[0.05, -y, 0.0] for y in behind]))
    *_, (memory, _) = mapped(drive, told=true_bearings)
    assert (memory.geometry is None) == wall


def test_no_geometry_begins_where_none_fits(drive) -> None:
    rng = np.random.default_rng(4)
    memory = KeyframeMap(drive.mount)
    for k in range(4):
        observations = drive.observations(k)
        random = replace(observations, current=rng.permutation(observations.current))
        memory, said = memory.after(random, bearings=(Bearings(-1.4, 3.0),))
    assert memory.bootstrap.is_due
    assert memory.update_map().geometry is None
    assert said is None


@given(seed=st.integers(0, 10**6), count=st.integers(0, 30), same=st.booleans())
@settings(max_examples=30, deadline=None)
def test_whatever_is_seen_it_stays_within_bounds_and_never_raises(seed, count, same) -> None:
    rng = np.random.default_rng(seed)
    memory = KeyframeMap(Attitude(), MapSettings(keyframes=4, features=20))
    rays = rng.normal(size=(30, 3))
    for _ in range(8):
        ids = rng.permutation(30)[:count]
        drawn = rays[ids] if same else rng.normal(size=(count, 3))
        drawn = drawn / np.linalg.norm(drawn, axis=1)[:, None]
        noise = np.full((count, 2), 1e-3)
        observations = FeatureObservations(ids, drawn, drawn[::-1] if seed % 2 else drawn, noise)
        memory, said = memory.after(
            observations, rng.normal(size=2), bearings=(Bearings(*rng.uniform(-3, 3, 2)),)
        )
        assert len(memory.window) <= 4
        assert said is None or np.isfinite(said.pose).all()
