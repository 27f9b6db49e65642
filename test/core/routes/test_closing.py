"""Closing: the end of a way is bent onto its beginning, and driven as fast."""

from dataclasses import replace
import math

import numpy as np
import pytest
from routes import key_view, route_of

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.planar_poses import compose, relative_pose
from visual_servo_epipolar.core.routes.following.closing import Closing, closing_of
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.places import Place, PlaceFinder
from visual_servo_epipolar.core.routes.route import RouteView
from visual_servo_epipolar.core.routes.structure import ViewPose

RADIUS, COUNT, SPEED = 1.5, 9, 0.5
LENGTH = 2.0 * math.pi * RADIUS
OVERLAP = 0.4  # that the way is taught to drive over its beginning [m]


def on_circle(way: float) -> FloatArray:
    """Return the pose after a way around a circle, in axes of its beginning, (3,)."""
    angle = way / RADIUS
    return np.array([RADIUS * math.sin(angle), RADIUS * (1.0 - math.cos(angle)), angle])


def view_at(number: int) -> RouteView:
    """Return a key view of a circle driven once and a little more, from and to a standstill."""
    last = LENGTH + OVERLAP
    at = number * last / COUNT
    way = np.arange(max(at - 1.5, 0.0), min(at + 0.9, last) + 1e-9, 0.05)
    poses = np.array([relative_pose(on_circle(at), on_circle(each)) for each in way])
    poses[:, 2] = (way - at) / RADIUS
    speeds = np.minimum(SPEED, np.sqrt(0.5 * np.minimum(way, last - way) + 1e-9))
    path = TaughtPath(way, poses, np.full(len(way), 1.0 / RADIUS), speeds)
    return replace(key_view(number), path=path, way=at, pose=on_circle(at))


ROUTE = route_of(*(view_at(number) for number in range(COUNT + 1)))


def closing_beside(offset: float, turn: float) -> Closing:
    """Return the closing of a way that ends beside its beginning."""
    pose = compose(on_circle(OVERLAP), np.array([0.0, offset, turn]))
    return Closing(OVERLAP, offset, turn, pose, LENGTH)


def across(pose: FloatArray, path: FloatArray) -> float:
    """Return how far left of a ``path`` pose, (3,), another ``pose`` is [m]."""
    away = pose[:2] - path[:2]
    return float(away[1] * math.cos(path[2]) - away[0] * math.sin(path[2]))


@pytest.mark.parametrize(('offset', 'turn'), [(0.0, 0.0), (0.1, -0.05), (-0.2, 0.1)])
def test_the_end_leads_onto_the_beginning_in_its_direction_and_curvature(
    offset: float, turn: float
) -> None:
    closing = closing_beside(offset, turn)
    last = closing.lap(ROUTE.views, begin=False, end=True)[-1].path
    end, begin = compose(closing.pose, last.pose_at(last.way[-1])), on_circle(OVERLAP)
    assert across(end, begin) == pytest.approx(0.0, abs=1e-3)
    assert end[2] == pytest.approx(begin[2], abs=1e-3)
    assert last.curvature_at(last.way[-1]) == pytest.approx(1.0 / RADIUS)
    # Every sample heads where the path goes.
    steps = np.diff(last.poses[:, :2], axis=0)
    middle = 0.5 * (last.poses[1:, 2] + last.poses[:-1, 2])
    assert np.arctan2(steps[:, 1], steps[:, 0]) == pytest.approx(middle, abs=1e-2)


def test_away_from_its_end_the_path_is_as_taught() -> None:
    views = closing_beside(0.2, 0.1).lap(ROUTE.views, begin=False, end=True)
    for view, taught in zip(views[:5], ROUTE.views[:5], strict=True):
        assert np.array_equal(view.path.poses, taught.path.poses)
    assert np.array_equal(views[-1].path.poses[0], ROUTE.views[-1].path.poses[0]) is False
    plain = closing_beside(0.2, 0.1).lap(ROUTE.views, begin=True, end=False)
    assert all(
        np.array_equal(view.path.poses, taught.path.poses)
        for view, taught in zip(plain, ROUTE.views, strict=True)
    )


@pytest.mark.parametrize(('begin', 'end'), [(True, False), (False, True), (True, True)])
def test_a_lap_neither_stops_nor_starts_where_the_way_closes(begin: bool, end: bool) -> None:
    views = closing_beside(0.0, 0.0).lap(ROUTE.views, begin=begin, end=end)
    first, last = views[0].path, views[-1].path
    assert bool(first.speeds.min() > 0.9 * SPEED) is begin
    assert bool(last.speeds.min() > 0.9 * SPEED) is end


def find_there(
    monkeypatch: pytest.MonkeyPatch, way: float, offset: float, turn: float
) -> list[range | None]:
    """Make the last photograph be found there; the ranges that were asked for come as a list."""
    asked: list[range | None] = []

    def find(finder: PlaceFinder, image: Image, among: range | None = None) -> Place:
        asked.append(among)
        pose = relative_pose(on_circle(ROUTE.views[1].way), on_circle(way))
        pose = compose(pose, np.array([0.0, offset, turn]))
        return Place(1, ViewPose(pose, np.eye(3) * 1e-6, 40, 20, 0.01), way, offset, turn)

    monkeypatch.setattr(PlaceFinder, 'find', find)
    return asked


def test_the_last_photograph_is_looked_for_where_the_way_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = find_there(monkeypatch, OVERLAP, 0.1, 0.05)
    closing = closing_of(ROUTE, PlaceFinder(ROUTE))
    assert asked == [range(5)]
    assert closing is not None
    assert closing.length == pytest.approx(LENGTH)
    assert closing.pose == pytest.approx(closing_beside(0.1, 0.05).pose)


@pytest.mark.parametrize(
    ('way', 'offset', 'turn'), [(-0.5, 0.0, 0.0), (0.4, 0.6, 0.0), (0.4, 0.0, -0.5)]
)
def test_a_way_that_ends_elsewhere_does_not_close_and_says_where_it_ends(
    way: float, offset: float, turn: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    find_there(monkeypatch, way, offset, turn)
    finder = PlaceFinder(ROUTE)
    assert closing_of(ROUTE, finder) is None
    assert f'the way ends {way:+.2f} m along its beginning' in finder.reason


def test_across_the_closing_poses_are_those_of_the_place() -> None:
    closing = closing_beside(0.1, 0.05)
    views, last = ROUTE.views, COUNT
    there = closing.transform(views, last, 1)
    assert there == pytest.approx(relative_pose(views[1].pose, closing.pose))
    back = closing.transform(views, 1, last)
    assert compose(there, back) == pytest.approx(np.zeros(3), abs=1e-9)
