"""Chain: how key views lie to each other, by all views that two neighbours both place."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.planar_poses import compose, inverse_pose, relative_pose
from visual_servo_epipolar.core.routes.route import Route, RouteView

SPACING = 0.1  # between poses of a path [m]


def chained(
    views: Sequence[RouteView], located: Sequence[Mapping[int, FloatArray]]
) -> tuple[RouteView, ...]:
    """Return key views with their poses in axes of the first, by frames that both placed."""
    pose, chain = np.zeros(3), []
    for k, view in enumerate(views):
        if k:
            before, here = located[k - 1], located[k]
            common = sorted(before.keys() & here.keys())
            if not common:
                raise DegenerateGeometryError(
                    f'two key views after {view.way:.2f} m show nothing in common; '
                    'drive slower there'
                )
            steps = np.array([compose(before[j], inverse_pose(here[j])) for j in common])
            # Medians: a single view that one of both places wrongly must not bend the route.
            step = np.median(np.unwrap(steps, axis=0, period=2.0 * math.pi), axis=0)
            pose = compose(pose, step)
        chain.append(replace(view, pose=pose))
    return tuple(chain)


def path_poses(route: Route) -> Iterator[FloatArray]:
    """Yield poses along the path, (3,), in axes of the first key view: each by the one ahead."""
    yield route.views[0].pose
    for before, view in zip(route.views[:-1], route.views[1:], strict=True):
        count = max(round((view.way - before.way) / SPACING), 1)
        for way in np.linspace(before.way, view.way, count + 1)[1:].tolist():
            yield compose(view.pose, view.path.pose_at(way))


def seam(views: Sequence[RouteView]) -> FloatArray:
    """
    Return by how much neighbours disagree on the path, across it, (K - 1,) [m].

    Root of the mean square over the way that both know, with the one's path in the other's axes.
    """
    return np.array([_seam(a, b) for a, b in zip(views[:-1], views[1:], strict=True)])


def _seam(first: RouteView, second: RouteView) -> float:
    T_first_second = relative_pose(first.pose, second.pose)
    low = max(first.path.way[0], second.path.way[0])
    high = min(first.path.way[-1], second.path.way[-1])
    ways = second.path.way[(second.path.way >= low) & (second.path.way <= high)]
    if not len(ways):
        return math.nan
    points = [
        first.path.beside(compose(T_first_second, second.path.pose_at(way)), way) for way in ways
    ]
    return math.sqrt(float(np.mean([point.offset**2 for point in points])))
