"""
Chain: how key views lie to each other, by all views that two neighbours both place.

Where they share none, the odometry bridges what is between; where it differs from the
structure by more than wheels slip, the key view is rejected.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimate.map_state import TURN_OF_WAY
from visual_servo_epipolar.core.estimate.odometry import TURN_SHARE
from visual_servo_epipolar.core.geometry.motion import compose, inverse_pose, relative_pose
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.route import Bridge, Route, RouteView
from visual_servo_epipolar.core.routes.structure import SCALE_DEVIATION

SPACING = 0.1  # between poses of a path [m]
UNKNOWN_TURN = 0.02  # deviation of a turn by odometry that nothing was held against [rad]


class DrivenFrame(NamedTuple):
    """
    Image on the way: its number, where the base was by odometry, (3,), and how far it drove.

    There the base drives at a ``speed`` [m/s], or ``turns`` on the spot.
    """

    number: int
    image: Image
    stamp_ns: int
    pose: FloatArray
    way: float
    speed: float
    turns: bool = False


class LearntView(NamedTuple):
    """A key view, the poses in its axes of frames that it places, and its own frame."""

    view: RouteView
    located: Mapping[int, FloatArray]
    frame: DrivenFrame


class ViewStep(NamedTuple):
    """From one key view to the next, as learnt, None where they share no frame, and as driven."""

    learnt: FloatArray | None
    driven: FloatArray
    way: float

    @property
    def turn(self) -> float:
        """By how much more than by the odometry it turns to the left, as learnt [rad]."""
        off = 0.0 if self.learnt is None else float(self.learnt[2] - self.driven[2])
        return math.remainder(off, 2.0 * math.pi)

    @property
    def longer(self) -> float:
        """By how much farther than by the odometry it is, as learnt [m]."""
        learnt = self.driven if self.learnt is None else self.learnt
        return float(np.hypot(*learnt[:2]) - np.hypot(*self.driven[:2]))

    @property
    def is_believed(self) -> bool:
        """Whether both differ by no more than wheels slip."""
        largest = max(abs(float(self.driven[2])), abs(float(self.driven[2]) + self.turn))
        most = 2.0 * UNKNOWN_TURN + TURN_OF_WAY * self.way + TURN_SHARE * largest
        return abs(self.turn) <= most


def step_between(before: LearntView, view: LearntView) -> ViewStep:
    """Return how a key view lies to the one ``before``: the median of frames that both placed."""
    driven = relative_pose(before.frame.pose, view.frame.pose)
    way = view.view.way - before.view.way
    common = sorted(before.located.keys() & view.located.keys())
    if not common:
        return ViewStep(None, driven, way)
    steps = np.array([compose(before.located[j], inverse_pose(view.located[j])) for j in common])
    # Medians: a single view that one of both places wrongly must not bend the route.
    return ViewStep(np.median(np.unwrap(steps, axis=0, period=2.0 * math.pi), axis=0), driven, way)


def believed(views: Sequence[LearntView]) -> list[LearntView]:
    """
    Return the key views without those that the odometry contradicts.

    Raises DegenerateGeometryError where it contradicts half of them.
    """
    known = [(step, way) for step, way in _steps(views) if step.learnt is not None]
    wrong = [(step, way) for step, way in known if not step.is_believed]
    if wrong and 2 * len(wrong) >= len(known):
        worst, way = max(wrong, key=lambda it: abs(it[0].turn))
        raise DegenerateGeometryError(
            f'before {way:.2f} m the images turn by {math.degrees(worst.turn):+.0f} deg more than '
            f'the odometry, and {len(wrong)} of {len(known)} key views by more than wheels slip; '
            'use the odometry and the calibration of this very drive'
        )
    kept = list(views[:1])
    for view in views[1:]:
        if step_between(kept[-1], view).is_believed:
            kept.append(view)
    return kept


def _steps(views: Sequence[LearntView]) -> list[tuple[ViewStep, float]]:
    """Return the steps from each key view to the next, and the way [m] at which they end."""
    pairs = zip(views[:-1], views[1:], strict=True)
    return [(step_between(*pair), pair[1].view.way) for pair in pairs]


def against_odometry(views: Sequence[LearntView]) -> list[str]:
    """Return in one line how turns and ways as learnt differ from the odometry, if known."""
    known = [(step, way) for step, way in _steps(views) if step.learnt is not None]
    if not known:
        return []
    turned, at = max(known, key=lambda it: abs(it[0].turn))
    longer, there = max(known, key=lambda it: abs(it[0].longer))
    rms = math.sqrt(float(np.mean([step.turn**2 for step, _ in known])))
    return [
        f'against the odometry key views turn by {math.degrees(rms):.1f} deg rms, most before '
        f'{at:.2f} m: {math.degrees(turned.turn):+.1f} deg; the longest way is before '
        f'{there:.2f} m: {longer.longer:+.3f} m'
    ]


def chained(views: Sequence[LearntView], driven: Sequence[DrivenFrame]) -> tuple[RouteView, ...]:
    """Return key views with their poses in axes of the first; ``driven`` are all frames."""
    steps = [step for step, _ in _steps(views)]
    off = [step.turn for step in steps if step.learnt is not None]
    deviation = math.sqrt(float(np.mean(np.square(off)))) if off else UNKNOWN_TURN
    pose, chain = np.zeros(3), [replace(it.view, pose=np.zeros(3)) for it in views[:1]]
    for before, learnt, step in zip(views[:-1], views[1:], steps, strict=True):
        view, motion = learnt.view, step.learnt
        if motion is None:
            motion = step.driven
            view = _bridged(learnt, before.view.path.way[-1], driven)
            turn = float(motion[2])
            way = max(float(learnt.view.path.way[0] - before.view.path.way[-1]), 0.0)
            turned = math.hypot(deviation, SCALE_DEVIATION * turn)
            bridge = Bridge(way, turn, way * math.hypot(SCALE_DEVIATION, turned), turned)
            view = replace(view, bridge=bridge)
        pose = compose(pose, motion)
        chain.append(replace(view, pose=pose))
    return tuple(chain)


def _bridged(learnt: LearntView, begin: float, driven: Sequence[DrivenFrame]) -> RouteView:
    """Return a key view whose path begins at a way [m], by the odometry."""
    view, path, first = learnt.view, learnt.view.path, driven[min(learnt.located)]
    frames = [it for it in driven if begin < it.way < path.way[0] and not it.turns]
    if not frames:
        return view
    poses = relative_pose(first.pose, np.array([frame.pose for frame in frames]))
    prefix = TaughtPath(
        np.array([frame.way for frame in frames]),
        compose(path.poses[0], poses),
        np.full(len(frames), path.curvatures[0]),
        np.array([frame.speed for frame in frames]),
    )
    return replace(view, path=prefix.followed_by(path))


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
