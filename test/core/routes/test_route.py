"""Route: a value that exists is one that can be followed."""

from dataclasses import replace
import math

import numpy as np
import pytest
from routes import CAMERA as SMALL
from routes import key_view, route_of

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.follower import Confirmation
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.path import smooth_path, TaughtPath
from visual_servo_epipolar.core.routes.places import _located, CERTAIN, Place, PlaceFinder
from visual_servo_epipolar.core.routes.run import RouteRun
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.routes.structure import Localizer, LocalStructure, ViewPose
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.matching import CurrentView


@pytest.mark.parametrize(
    ('change', 'match'),
    [
        *(({'way': way}, 'ways of key views must') for way in (0.0, -1.0, math.nan, math.inf)),
        ({'pose': np.array([0.0, math.nan, 0.0])}, 'pose of a key view must be three finite'),
    ],
)
def test_ways_that_do_not_rise_and_poses_that_are_not_finite_are_refused(change, match) -> None:
    with pytest.raises(ValueError, match=match):
        route_of(key_view(0), replace(key_view(1), **change))


@pytest.mark.parametrize(
    ('station', 'reverse', 'match'),
    [(0, False, 'begins forward'), (1, True, 'begins in reverse'), (2, False, 'one of 0 to 1')],
)
def test_a_station_that_the_direction_cannot_reach_is_refused(station, reverse, match) -> None:
    route = route_of(replace(key_view(0), is_station=True), *map(key_view, range(1, 3)))
    with pytest.raises(InputError, match=match):
        RouteRun(route, FollowSettings(station=station, reverse=reverse), ServoSettings())


def test_a_start_beyond_the_station_fails_with_what_to_do() -> None:
    route = route_of(key_view(0), replace(key_view(1), is_station=True), key_view(2))
    run = RouteRun(route, FollowSettings(station=0), ServoSettings(), way=1.8)
    step = run.step(route.views[0].image, 0)
    assert run.ended and 'behind; repeat the route in reverse' in step.reason


def test_a_car_keeps_to_its_curvature() -> None:
    route = route_of(*map(key_view, range(3)))
    car = ServoSettings(base='car', law='smooth', max_curvature=1.5)
    base = RouteRun(route, FollowSettings(max_speed=0.2), car).base
    assert base.max_curvature == car.drive.max_curvature == 1.5
    assert (base.limits.max_linear, base.limits.max_angular) == (0.2, car.max_angular)


def test_a_run_that_did_not_arrive_renews_nothing() -> None:
    route = route_of(*map(key_view, range(3)))
    run = RouteRun(route, FollowSettings(renewals=2), ServoSettings())
    run._confirmed[1] = Confirmation(0.0, key_view(9).image, Features())
    assert run.confirmed == 1 and run.renewed().views == route.views


RADIUS, NOISE = 1.15, np.array([1e-3, 1e-3, 2e-4])


def arc_poses(way: np.ndarray) -> np.ndarray:
    turn = way / RADIUS
    return np.stack([RADIUS * np.sin(turn), RADIUS * (1.0 - np.cos(turn)), turn], axis=1)


WAY = np.arange(0.0, 1.5, 0.045)


def smoothed(off: np.ndarray) -> TaughtPath:
    """Return the path by poses that are ``off`` the arc."""
    return smooth_path(WAY, arc_poses(WAY) + off, np.full(len(WAY), 0.5))


@pytest.fixture
def path() -> TaughtPath:
    return smoothed(NOISE * np.random.default_rng(1).standard_normal((len(WAY), 3)))


def test_smoothing_takes_noise_and_keeps_the_curve(path: TaughtPath) -> None:
    assert np.abs(path.poses - arc_poses(WAY))[3:-3].max() < 1e-3
    assert path.curvatures[5:-5] == pytest.approx(1.0 / RADIUS, abs=0.02)
    wrong = np.zeros((len(WAY), 3))
    wrong[15] = 0.0, 0.2, 0.05  # a view that was placed wrongly
    assert np.abs(smoothed(wrong).poses - arc_poses(WAY))[10:20].max() < 1e-3


@pytest.mark.parametrize('way', [0.3, 0.62, 1.1])
@pytest.mark.parametrize('offset', [-0.05, 0.0, 0.08])
def test_offset_and_turn_are_those_beside_the_arc(path, way, offset) -> None:
    turn = way / RADIUS
    reach = RADIUS - offset
    pose = np.array([reach * math.sin(turn), RADIUS - reach * math.cos(turn), turn + 0.1])
    point = path.beside(pose, way + 0.1)
    assert point.way == pytest.approx(way, abs=5e-3)
    assert point.offset == pytest.approx(offset, abs=1e-3)
    assert point.turn == pytest.approx(0.1, abs=5e-3)


def test_a_path_needs_samples_that_follow_each_other() -> None:
    with pytest.raises(ValueError, match='two samples or more'):
        TaughtPath(np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros(1))


CAMERA = calibrated_camera(
    (640, 480), (385.0, 0.0, 319.5, 0.0, 385.0, 239.5, 0.0, 0.0, 1.0), (), 'plumb_bob'
)
# A cabinet 2.5 m ahead, and the walls around it: right, down, ahead [m].
CABINET = np.random.default_rng(1).uniform((-0.9, -0.8, 2.4), (-0.5, 0.8, 2.7), (32, 3))
WALLS = np.random.default_rng(2).uniform((-1.2, -1.0, 4.0), (1.5, 0.5, 7.0), (14, 3))
SHIFT = np.array([0.0, 0.0, 0.14])  # of the cabinet along its wall [m]
THERE = np.array([0.3, 0.05, 0.02])


def placed(taught: FloatArray, today: FloatArray) -> ViewPose | None:
    """Return where a camera THERE seems to be, by points, (N, 3), as taught and as today."""
    depths = np.linalg.norm(taught, axis=1)
    covariance = np.repeat(np.diag([0.1, 0.1, 1e-6])[:, :, None], len(taught), axis=2)
    rest = 1.0 / depths, covariance, np.zeros(5), 0.002, 0.1
    structure = LocalStructure(pixels_of(taught), np.zeros((2, len(taught))), *rest)
    x, y, turn = THERE.tolist()
    away = today - [-y, 0.0, x]
    cos, sin = np.cos(turn), np.sin(turn)
    seen = away @ np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    return Localizer(structure, CAMERA).locate(
        np.arange(len(taught)), pixels_of(seen), np.zeros(3)
    )


def pixels_of(points: FloatArray) -> FloatArray:
    return np.asarray(385.0 * points[:, :2] / points[:, 2:] + [319.5, 239.5])


def test_a_view_is_placed_and_its_witnesses_stand_elsewhere_but_not_far_away() -> None:
    """A door seen through another agrees with whatever a board near the robot says."""
    far = np.random.default_rng(3).uniform((-0.5, -0.3, 9.0), (0.0, 0.3, 9.3), (14, 3))
    for others, is_certain in ((WALLS, True), (far, False)):
        found = placed(np.vstack([CABINET, others]), np.vstack([CABINET, others]))
        assert found is not None and found.inliers == 46
        assert found.pose == pytest.approx(THERE, abs=1e-3)
        assert (found.unaided < CERTAIN) is is_certain


@pytest.mark.parametrize(('unaided', 'is_believed'), [(0.04, True), (0.06, False)])
def test_a_place_that_one_object_tells_is_not_believed(unaided, is_believed, monkeypatch) -> None:
    place = ViewPose(THERE, 1e-6 * np.eye(3), 40, unaided)
    monkeypatch.setattr(KeyViewTracker, 'match', lambda *_: Features())
    monkeypatch.setattr(KeyViewTracker, 'place', lambda *_: place)
    image = np.zeros((48, 64), np.uint8)
    found = _located(image, CurrentView(image), key_view(0), SMALL)
    assert (found is place) is is_believed


def test_a_cabinet_that_was_moved_is_believed_only_where_nothing_else_is_seen() -> None:
    assert placed(np.vstack([CABINET, WALLS]), np.vstack([CABINET + SHIFT, WALLS])) is None
    found = placed(CABINET, CABINET + SHIFT)
    assert found is not None and found.unaided == math.inf
    assert found.pose == pytest.approx(THERE - [0.14, 0.0, 0.0], abs=1e-2)


@pytest.mark.parametrize(
    ('ways', 'offset', 'turn', 'lap'),
    [
        ((0.2,), 0.1, 0.05, 1.8),
        ((0.2,), 0.5, 0.0, math.inf),
        ((0.2,), 0.0, -0.5, math.inf),
        ((-0.5,), 0.0, 0.0, math.inf),
        ((0.2, 5.0), 0.0, 0.0, math.inf),
        ((), 0.0, 0.0, math.inf),
    ],
)
def test_a_way_closes_where_its_end_is_beside_its_beginning(
    ways, offset, turn, lap, monkeypatch
) -> None:
    pose = ViewPose(np.zeros(3), 1e-6 * np.eye(3), 40, 0.01)
    places = [Place(0, pose, way, offset, turn) for way in ways]
    monkeypatch.setattr(PlaceFinder, '_alike', lambda finder, image, among: places)
    finder = PlaceFinder(route_of(*map(key_view, range(3))))
    assert finder.lap == pytest.approx(lap)
