"""
Closing: where a way meets its own beginning, so that laps go on without a standstill.

The last photograph is looked for among the first key views. Where the way was taught to end beside
its beginning, its last metres are bent onto it: a lap has no step at its end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import compose, relative_pose
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.places import Place, PlaceFinder
from visual_servo_epipolar.core.routes.route import Route, RouteView

GAP = 0.3  # way that may be missing between end and beginning [m]
MOST_OFFSET, MOST_TURN = 0.4, 0.35  # of the end beside the beginning [m, rad]
RAMP = 0.8  # way on which a driver comes from a standstill, or to it [m]
BEND = 2.0  # way on which the end is bent onto the beginning [m]


@dataclass(frozen=True, eq=False)
class Closing:
    """
    Closing of a way: its last key view lies after ``way`` [m], ``offset`` and ``turn`` beside it.

    ``pose``, (3,), is that of the last key view in axes of the first; a lap has a ``length`` [m].
    """

    way: float
    offset: float
    turn: float
    pose: FloatArray
    length: float

    def transform(self, views: Sequence[RouteView], first: int, second: int) -> FloatArray:
        """Return the pose of key view ``first`` in axes of ``second``, (3,): one is the last."""
        last = len(views) - 1
        if first == last:
            return relative_pose(views[second].pose, self.pose)
        assert second == last
        return relative_pose(self.pose, views[first].pose)

    def on_lap(self, place: Place, views: Sequence[RouteView], near: float) -> Place:
        """Return the same place, by the way that is ``near`` another one [m]."""
        low, high = views[0].way - GAP, views[-1].way + GAP
        ways = (place.way + laps * self.length for laps in (-1, 0, 1))
        taught = [way for way in ways if low <= way <= high]
        way = min(taught, key=lambda it: abs(it - near), default=place.way)
        if way == place.way:
            return place
        pose, last = compose(views[place.view].pose, place.pose.pose), views[-1].pose
        before, after = (last, self.pose) if way < place.way else (self.pose, last)
        pose = compose(after, relative_pose(before, pose))
        ahead = next((view for view in views if view.way >= way), views[-1])
        point = ahead.path.beside(relative_pose(ahead.pose, pose), way)
        return replace(place, way=point.way, offset=point.offset, turn=point.turn)

    def lap(self, views: Sequence[RouteView], *, begin: bool, end: bool) -> tuple[RouteView, ...]:
        """
        Return the key views of a lap that has its ``begin``, or its ``end``, at the closing.

        There it drives on as fast as farther from it; its path ends on that of the beginning.
        """
        last, closed = views[-1].way, []
        there = _path_at(self.way, views).curvature_at(self.way)
        curvatures = views[-1].path.curvature_at(last), there
        for view in views:
            path = view.path
            if begin and path.way[0] < RAMP:
                path = replace(path, speeds=_raised(path, views[0].way, views))
            if end and path.way[-1] > last - RAMP:
                path = replace(path, speeds=_raised(path, last, views))
            if end:
                path = self._bent(path, last, curvatures)
            closed.append(replace(view, path=path))
        return tuple(closed)

    def _bent(self, path: TaughtPath, end: float, curvatures: tuple[float, float]) -> TaughtPath:
        """
        Return a path that comes to the beginning and its direction before ``end`` [m].

        There it was taught with the first of two ``curvatures`` [1/m], and gets the second.
        """
        reach = min(BEND, 0.5 * self.length)
        share = np.clip((path.way - (end - reach)) / reach, 0.0, 1.0)
        # Hermite polynomials of degree 5: at 0 nothing, at 1 one of three derivatives.
        by_offset = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
        by_turn = np.polynomial.Polynomial([0, 0, 0, -4, 7, -3])
        by_curvature = np.polynomial.Polynomial([0, 0, 0, 0.5, -1, 0.5])
        taught, wanted = curvatures
        stretch = 1.0 + taught * self.offset
        shift = -self.offset * by_offset - math.tan(self.turn) * stretch * reach * by_turn
        shift += (wanted * stretch - taught) * stretch * reach**2 * by_curvature
        slope, bend = shift.deriv()(share) / reach, shift.deriv(2)(share) / reach**2
        poses = path.poses.copy()
        poses[:, :2] += shift(share)[:, None] * path.normals
        longer = 1.0 - path.curvatures * shift(share)  # inside of a curve or outside
        poses[:, 2] += np.arctan(slope / longer)
        return replace(path, poses=poses, curvatures=(path.curvatures + bend / longer) / longer)


def _raised(path: TaughtPath, at: float, views: Sequence[RouteView]) -> FloatArray:
    """Return speeds, (M,), that within a ramp of a way ``at`` [m] are those beyond it."""
    begin, end = views[0].way, views[-1].way
    beyond = max(end - RAMP, begin) if at > begin else min(begin + RAMP, end)
    knows = _path_at(beyond, views)
    fast = np.interp(beyond, knows.way, knows.speeds)
    return np.where(np.abs(path.way - at) < RAMP, np.maximum(path.speeds, fast), path.speeds)


def _path_at(way: float, views: Sequence[RouteView]) -> TaughtPath:
    """Return the path that contains a ``way`` [m]."""
    return next((view.path for view in views if view.path.way[-1] >= way), views[-1].path)


def closing_of(route: Route, finder: PlaceFinder) -> Closing | None:
    """
    Return where the way meets its beginning; None, and ``finder`` says why, if it does not.

    The ``finder`` takes places a lap apart for one from then on.
    """
    last = route.views[-1]
    place = finder.find(last.image, range((len(route.views) + 1) // 2))
    if place is None:
        return None
    if place.way < -GAP or abs(place.offset) > MOST_OFFSET or abs(place.turn) > MOST_TURN:
        finder.reason = (
            f'the way ends {place.way:+.2f} m along its beginning, {place.offset:+.2f} m and '
            f'{place.turn:+.2f} rad beside it'
        )
        return None
    pose = compose(route.views[place.view].pose, place.pose.pose)
    finder.lap = last.way - place.way
    return Closing(place.way, place.offset, place.turn, pose, finder.lap)
