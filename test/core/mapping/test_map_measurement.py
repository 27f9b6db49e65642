"""Reading and recollection: quantities of a measurement, as pose and covariance have it."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from map_bound import errors_of, TrialErrors
from map_study import StudySettings, StudyTrial, two_views
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.localization import (
    difference_slope,
    MapLocalization,
)
from visual_servo_epipolar.core.mapping.window import MapSettings
from visual_servo_epipolar.core.twoview.measurement import feature_difference

PLACES = st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, -0.2), st.floats(-1.0, 1.0))
COVARIANCE = np.diag([1e-6, 4e-6, 4e-6, 1e-8, 1e-8])


def recollection(place, covariance=COVARIANCE) -> MapLocalization:
    """Return what would be said of a place."""
    return MapLocalization(
        np.array([*place, 0.0, 0.0]), covariance, 0.5 * covariance, None, np.ones(0), np.zeros(5)
    )


@given(place=PLACES)
@settings(max_examples=40, deadline=None)
def test_bearings_are_those_of_the_pose(place) -> None:
    x, y, heading = place
    expected = Bearings.from_pose(Pose(x, y, heading + 0.5 * math.pi))
    bearings = recollection(place).bearings
    assert math.remainder(bearings.psi - expected.psi, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert math.remainder(bearings.phi - expected.phi, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert bearings.heading_error == pytest.approx(heading, abs=1e-9)


@given(place=PLACES)
@settings(max_examples=20, deadline=None)
def test_covariance_of_bearings_is_that_of_poses_around(place) -> None:
    rng = np.random.default_rng(1)
    root = np.linalg.cholesky(COVARIANCE[:3, :3])
    poses = np.array(place) + rng.normal(size=(4000, 3)) @ root.T
    psi = np.arctan2(poses[:, 1], poses[:, 0])
    drawn = np.cov(np.stack([psi, psi - poses[:, 2]]))
    told = recollection(place).bearings_covariance
    assert np.sqrt(np.diag(told)) == pytest.approx(np.sqrt(np.diag(drawn)), rel=0.05)


def test_at_the_goal_itself_there_are_no_bearings_but_offsets() -> None:
    said = recollection((0.0, 0.0, 0.01))
    assert said.bearings is None
    assert said.lateral_deviation == pytest.approx(1e-3)
    assert said.longitudinal_deviation == pytest.approx(2e-3)
    slope = difference_slope(np.array([[0.6, 0.0, 0.8]]), np.array([0.2]))
    reading = replace(said, difference_slope=slope)
    assert (reading.lateral, reading.difference) == (0.0, 0.0)
    assert math.isfinite(reading.bearings_deviation)


@pytest.mark.parametrize('wide', [False, True])
def test_difference_is_that_of_features_seen_from_there(wide: bool) -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-1.5, 1.5, (40, 2)), rng.uniform(3.0, 8.0, 40)])
    length = np.linalg.norm(points, axis=1)
    desired = points / length[:, None]
    moved = points - [0.0, 0.0, 1e-4]
    current = moved / np.linalg.norm(moved, axis=1)[:, None]
    expected = float(feature_difference(current, desired, wide)) / 1e-4
    assert difference_slope(desired, 1.0 / length, wide=wide) == pytest.approx(expected, rel=1e-3)


RATIO = 1.4
SURE = MapSettings(scale_deviation=1e-3)
OTHER = MapSettings(scale_deviation=2e-3)


def remembered(
    drive: StudyTrial, swapped_at: int | None = None, ratio: float = RATIO
) -> KeyframeMap:
    """Return the memory of a drive whose way was ``ratio`` as long by the other account."""
    memory, other = KeyframeMap(drive.mount, SURE), False
    for k in range(14):
        if k == swapped_at:
            memory, other = memory.with_alternative(OTHER), True
        motion = drive.motion(k)
        accounts = (ratio * motion, motion) if other else (motion, ratio * motion)
        told = two_views(drive, k).bearings if memory.geometry is None else ()
        memory, _ = memory.after(
            drive.observations(k), accounts[0], alternative_motion=accounts[1], bearings=told
        )
        memory = memory.update_map()
    return memory


def whole(memory: KeyframeMap) -> float:
    """Return the way from keyframe to keyframe in the geometry [m]."""
    steps = np.diff(memory.geometry.unknowns.views[:, :2], axis=0)
    return float(np.hypot(*steps.T).sum())


def test_a_map_by_the_alternative_motion_and_back_is_as_before(drive) -> None:
    before = remembered(drive)
    again = before.with_alternative(OTHER).with_alternative(SURE)
    assert whole(again) == pytest.approx(whole(before), rel=1e-6)
    assert again.place == pytest.approx(before.place)
    assert again.window.driven_places == pytest.approx(before.window.driven_places)


@pytest.mark.parametrize('at', [0, 1, 9])
def test_the_alternative_scale_holds_for_the_whole_way_whenever_it_is_chosen(drive, at) -> None:
    late = remembered(drive, swapped_at=at)
    assert whole(late) / float(late.window.ways.sum()) == pytest.approx(1.0, rel=0.02)
    depth = remembered(drive).geometry.depth
    assert late.geometry.depth == pytest.approx(RATIO * depth, rel=0.05)


TRIALS, FEW = 40, 16


@pytest.fixture(
    scope='module',
    params=[False, pytest.param(True, marks=pytest.mark.long)],
    ids=['room', 'wall'],
)
def errors(request: pytest.FixtureRequest) -> TrialErrors:
    """Return the errors of drives through a room, or before one wall."""
    return errors_of(StudySettings(wall=request.param), range(TRIALS))


def test_every_drive_ends_with_a_pose(errors: TrialErrors) -> None:
    assert errors.silent == 0


def test_no_estimate_could_be_much_more_exact(errors: TrialErrors) -> None:
    assert (errors.rms <= 1.2 * errors.bound).all()
    assert (errors.rms >= 0.75 * errors.bound).all()  # three deviations of luck


def test_it_is_as_sure_as_it_is_exact(errors: TrialErrors) -> None:
    assert 0.9 <= errors.normalised_error <= 1.2


def test_wrong_matches_are_dropped_and_hardly_any_other(errors: TrialErrors) -> None:
    assert errors.found == errors.wrong > 100
    assert errors.innocent <= 0.005 * 57 * TRIALS


@pytest.mark.long
@pytest.mark.parametrize('wall', [False, True], ids=['room', 'wall'])
@pytest.mark.parametrize('seen', [{'noise': 0.03}, {'slips': 0.05}], ids=['hundredths', 'slips'])
def test_as_well_where_tracks_are_exact_and_where_some_slip(wall, seen) -> None:
    errors = errors_of(StudySettings(wall=wall, **seen), range(FEW))
    assert errors.silent == 0
    assert (errors.rms <= 1.5 * errors.bound).all()  # luck of few trials
    assert 0.8 <= errors.normalised_error <= 1.25
