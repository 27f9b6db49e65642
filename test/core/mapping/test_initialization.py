"""Initialization: from rough bearings to the geometry, and to that of which features lie ahead."""

from dataclasses import replace
import math

from map_study import StudySettings, StudyTrial, trial
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.wall import exchanged_bearings
from visual_servo_epipolar.core.mapping.initialization import (
    held_views,
    initial_geometry,
    is_sound,
    is_sure,
    orient_ahead,
    Start,
)
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import EMPTY, KeyframeWindow, MapSettings
from visual_servo_epipolar.core.twoview.estimator import Attitude


def start_at(view: np.ndarray, k: int, off: float = 0.0) -> Start:
    """Return what two views would tell of a view, ``off`` by as much in psi and phi [rad]."""
    psi = math.atan2(view[1], view[0]) + off
    phi = psi - view[2] - 0.5 * math.pi
    return Start(k, Bearings(psi, phi), Attitude())


def begun(drive: StudyTrial) -> tuple[KeyframeWindow, list[Start]]:
    """Return the window of all views of a drive, and what two views would tell of each."""
    window = EMPTY
    for k, view in enumerate(drive.views):
        window = window.with_view(drive.observations(k), view[:2])
    return window, [start_at(view, k) for k, view in enumerate(drive.views)]


@pytest.mark.parametrize('off', [0.0, 0.05, -0.2])
def test_rough_bearings_are_enough_to_begin_with(exact, off: float) -> None:
    start = start_at(exact.unknowns.views[1], 1, off)
    geometry = initial_geometry(exact.window, [start], Attitude(), MapSettings())
    assert geometry is not None
    assert geometry.unknowns.views[:, :3] == pytest.approx(exact.unknowns.views[:, :3], abs=0.02)


def test_of_several_starts_the_one_that_fits_best_is_taken(exact) -> None:
    wrong, right = (start_at(exact.unknowns.views[1], 1, off) for off in (1.2, 0.0))
    for starts in ([wrong, right], [right, wrong]):
        geometry = initial_geometry(exact.window, starts, Attitude(), MapSettings())
        assert geometry is not None
        assert geometry.evaluation.cost < 1.0


def test_of_a_geometry_and_its_reverse_the_one_with_features_ahead_is_taken(exact) -> None:
    reverse = replace(exact, unknowns=exact.unknowns.scaled(-1.0))
    assert reverse.cost == pytest.approx(exact.cost, abs=1e-6)  # they look the same
    assert orient_ahead(exact) is exact
    for geometry in (orient_ahead(reverse), exact):
        assert geometry.unknowns.views == pytest.approx(exact.unknowns.views)
        assert (geometry.unknowns.inverse_depth > 0.0).all()


def test_a_geometry_is_unsound_by_noise_by_few_features_or_by_a_view_that_nothing_holds(
    exact,
) -> None:
    assert is_sound(Geometry(exact))
    louder = replace(exact.window, tangent_basis=exact.window.tangent_basis * 10.0)
    offsets = 3.0 * np.random.default_rng(1).normal(size=exact.unknowns.offsets.shape)
    shaken = replace(exact.unknowns, offsets=offsets)
    assert not is_sound(Geometry(replace(exact, window=louder, unknowns=shaken)))
    few = np.arange(len(exact.trusted)) < 0.3 * len(exact.trusted)
    assert not is_sound(Geometry(replace(exact, trusted=few)))
    views = exact.unknowns.views.copy()
    views[2, :3] += [3.0, 5.0, 1.0]
    flung = Geometry(replace(exact, unknowns=replace(exact.unknowns, views=views)))
    assert held_views(flung).tolist() == [k != 2 for k in range(14)]
    assert not is_sound(flung)


@pytest.mark.parametrize(('apart', 'expected'), [(0.4, True), (0.02, False)])
def test_a_geometry_is_sure_where_its_views_are_apart(truth_of, apart, expected) -> None:
    """From views side by side depths may be anything, and with them the place of the next view."""
    places = np.array([[0.9, -3.0, -0.15], [0.9, -3.0 + apart, -0.15]])
    for scale_deviation in (0.05, 1.0):
        at = truth_of(trial(StudySettings(wrong=0.0), 2, places), 2)
        factors = replace(at.factors, scale_deviation=scale_deviation)
        assert is_sure(Geometry(replace(at, factors=factors))) is expected


def test_a_view_that_does_not_fit_is_left_out_and_the_rest_begins(exact) -> None:
    # One view shows other features than it says; its place would take the whole scale along.
    tangent_basis = exact.window.tangent_basis.copy()
    tangent_basis[2] = np.roll(tangent_basis[2], 9, axis=-1)
    window = replace(exact.window, tangent_basis=tangent_basis)
    start = start_at(exact.unknowns.views[1], 1)
    geometry = initial_geometry(window, [start], Attitude(), MapSettings())
    assert geometry is not None
    assert len(geometry.window) == 13
    kept = np.delete(exact.unknowns.views, 2, axis=0)
    assert geometry.unknowns.views[:, :3] == pytest.approx(kept[:, :3], abs=0.02)


def test_views_turned_far_from_each_other_begin_as_well() -> None:
    # Half a field of view between two views: what one saw the other hardly does.
    places = np.array([[0.9, -3.0, -0.15], [0.7, -2.6, 0.33], [0.5, -2.2, 0.36], [0.3, -1.8, 0.3]])
    drive = trial(StudySettings(points=90, wall=True, wrong=0.0), 2, places)
    window, starts = begun(drive)
    geometry = initial_geometry(window, starts, drive.mount, MapSettings())
    assert geometry is not None
    assert len(geometry.window) == 4
    assert geometry.unknowns.views[:, :3] == pytest.approx(drive.views[:, :3], abs=0.25)


@pytest.mark.parametrize('seed', range(4))
def test_before_a_wall_false_bearings_begin_no_false_geometry(seed: int) -> None:
    """It was up to a metre off: the other geometry of the wall was compared, and never taken."""
    places = np.array([[0.9, -3.0, -0.15], [0.7, -2.6, 0.1], [0.5, -2.2, 0.2], [0.3, -1.8, 0.3]])
    drive = trial(StudySettings(points=90, wall=True, wrong=0.0), seed, places)
    wall, (window, _) = np.array([0.0, 0.2]), begun(drive)
    false = [exchanged_bearings(view, wall) for view in drive.views[:, :3]]
    starts = [Start(k, each, Attitude()) for k, each in enumerate(false)]
    geometry = initial_geometry(window, starts, drive.mount, MapSettings())
    if geometry is not None:
        assert geometry.unknowns.views[:, :3] == pytest.approx(drive.views[:4, :3], abs=0.1)


def homography(place: np.ndarray, heading: float, wall: np.ndarray) -> np.ndarray:
    """Return what a view turned left by ``heading`` at a place makes of points of a wall."""
    cosine, sine = math.cos(heading), math.sin(heading)
    turned = np.array([[cosine, sine], [-sine, cosine]])  # to axes of the view, right and ahead
    return np.asarray(turned @ (np.eye(2) - np.outer(place, wall)))


@pytest.mark.parametrize('seed', range(20))
def test_both_geometries_show_one_image(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, heading = rng.uniform([-1.0, -2.0], [1.0, -0.2]), rng.uniform(-0.5, 0.5)
    wall = rng.uniform([-0.1, 0.1], [0.1, 0.4])
    told = exchanged_bearings(np.array([*place, heading]), wall)
    assert told is not None
    direction = np.array([math.cos(told.psi), math.sin(told.psi)])
    back = homography(np.zeros(2), told.heading_error, np.zeros(2)).T
    # What is left of the true view's homography, once turned back, is I - p' m'^T.
    left = np.eye(2) - back @ homography(place, heading, wall)
    size = np.linalg.norm(left)
    assert np.linalg.norm(left - np.outer(direction, direction @ left)) < 1e-9 * size
    assert (direction @ wall) * (place @ wall) > 0.0  # on the same side of it
    again = exchanged_bearings(np.array([*direction, told.heading_error]), direction @ left)
    assert again is not None
    psi = math.remainder(again.psi - math.atan2(place[1], place[0]), math.tau)
    assert psi == pytest.approx(0.0)
    assert again.heading_error == pytest.approx(heading)


def test_without_a_place_or_a_wall_there_is_none() -> None:
    wall = np.array([0.0, 0.2])
    assert exchanged_bearings(np.zeros(3), wall) is None
    assert exchanged_bearings(np.array([0.1, -1.0, 0.0]), 0.0 * wall) is None
