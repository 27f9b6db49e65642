"""
Following: the taught path, by one image after the other.

The robot is placed in the structure of the key view ahead, and beside the path as that structure
shows it. Where a key view is reached, the next takes over: what both say differs by the seam,
which a filter spreads over some steps.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.bases.base import Base
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.geometry.planar_poses import compose, relative_pose
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.path import PathPoint
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.routes.steering import (
    brake,
    epipole_error,
    EPIPOLE_GAIN,
    LateralFilter,
    NEAREST,
    steer,
)
from visual_servo_epipolar.core.routes.structure import ViewPose
from visual_servo_epipolar.core.stamps import seconds_between

GATE = 4.0  # deviations of a view from what was predicted, from which it is not believed
GATE_FLOOR = np.array([0.02, 0.01])  # beside them [m, rad]
COASTED = 0.5  # time without a trusted view after which it stands [s]
CERTAIN, FEW = 0.01, 10  # deviation of the offset [m], and agreeing features, that slow it down


@dataclass(frozen=True, slots=True)
class RouteProgress:
    """
    RouteProgress on a route: the ``view`` ahead, ``remaining`` way [m], and where beside the path.

    ``lateral`` is to the left, with its deviation [m]; ``turn`` to the left [rad]; ``inliers``
    counts features that agree, 0 of an image that showed nothing. ``switched``: the key view is a
    new one.
    """

    view: int
    way: float
    remaining: float
    lateral: float
    lateral_deviation: float
    turn: float
    inliers: int
    switched: bool = False


class Follower:
    """
    Follows a route from key view ``view`` on, to ``target``: a step an image.

    In ``reverse`` it drives backward, seeing what was seen when the way was taught.

    ``is_there``: so near before the target that the servo takes over. ``lost`` [s] is the time
    without a view that was believed, ``reason`` says why.
    """

    def __init__(
        self,
        route: Route,
        settings: FollowSettings,
        base: Base,
        *,
        view: int = 1,
        target: int | None = None,
        way: float | None = None,
        reverse: bool = False,
    ) -> None:
        self.route, self.settings, self._base = route, settings, base
        self.view, self._sign = view, -1 if reverse else 1
        last = 0 if reverse else len(route.views) - 1
        self.target = last if target is None else target
        self.way = route.views[view - 1].way if way is None else way
        self.lost, self.reason = 0.0, ''
        self._trackers: dict[int, KeyViewTracker] = {}
        self._filter: LateralFilter | None = None
        self._sent: deque[tuple[int, Twist]] = deque(maxlen=32)
        self._stamp_ns: int | None = None
        self._curvature = 0.0
        self.twist = STANDSTILL

    @property
    def remaining(self) -> float:
        """Way that is left to the target [m]."""
        return self._sign * (self.route.views[self.target].way - self.way)

    @property
    def is_there(self) -> bool:
        """Whether the servo is to take over."""
        return self._is_last and self.remaining <= self.settings.station_distance

    @property
    def _is_last(self) -> bool:
        """Whether no key view follows: backward, what lies behind one is seen in the one ahead."""
        return self.view == (self.target if self._sign > 0 else self.target + 1)

    def step(self, image: Image, stamp_ns: int) -> RouteProgress:
        """Take in an image, uint8 of shape (H, W); ``twist`` is then what to drive."""
        dt = 0.0 if self._stamp_ns is None else seconds_between(self._stamp_ns, stamp_ns)
        self._predict(stamp_ns, dt)
        self._stamp_ns = stamp_ns
        switched = self._switch(image)
        found = self._look(image)
        self.lost = 0.0 if found is not None else self.lost + dt
        point = None if found is None else self._update(found)
        self._command(image, point, dt)
        self._sent.append((stamp_ns, self.twist))
        return self._progress(found, switched)

    def _progress(self, found: ViewPose | None, switched: bool) -> RouteProgress:
        it = self._filter or LateralFilter()
        return RouteProgress(
            self.view,
            self.way,
            self.remaining,
            float(it.state[0]),
            math.sqrt(it.covariance[0, 0]),
            float(it.state[1]),
            0 if found is None else found.inliers,
            switched,
        )

    def _predict(self, stamp_ns: int, dt: float) -> None:
        """Move on by what the base was told to do since the last image."""
        if self._filter is None or dt <= 0.0:
            return
        for twist, span in self._acting(stamp_ns - round(dt * 1e9), stamp_ns):
            self._filter = self._filter.moved(twist.linear, twist.angular, self._curvature, span)
            self.way += twist.linear * span

    def _acting(self, start_ns: int, end_ns: int) -> Sequence[tuple[Twist, float]]:
        """Return what acts on the base between two times, given its delay, with durations [s]."""
        late = round(self.settings.latency * 1e9)
        times = [(sent + late, twist) for sent, twist in self._sent]
        spans: list[tuple[Twist, float]] = []
        for k, (begin, twist) in enumerate(times):
            until = times[k + 1][0] if k + 1 < len(times) else end_ns
            span = min(until, end_ns) - max(begin, start_ns)
            if span > 0:
                spans.append((twist, span * 1e-9))
        return spans

    def _tracker(self, view: int) -> KeyViewTracker:
        if view not in self._trackers:
            self._trackers[view] = KeyViewTracker(self.route.views[view], self.route.camera)
        return self._trackers[view]

    def _switch(self, image: Image) -> bool:
        """Go on to the next key view where this one is reached and that one is seen."""
        border = self.route.views[self.view if self._sign > 0 else self.view - 1].way
        if self._is_last or self._sign * (border - self.way) > 0.0:
            return False
        views, number = self.route.views, self.view + self._sign
        following = self._tracker(number)
        if not following.begun:
            T = relative_pose(views[number].pose, views[self.view].pose)
            following.begin(image, compose(T, self._pose_in(self.view)))
        self._trackers.pop(self.view - self._sign, None)
        self.view = number
        return True

    def _pose_in(self, view: int) -> FloatArray:
        """Return the pose in axes of a key view, (3,), by progress and filter."""
        pose = self.route.views[view].path.pose_at(self.way)
        if self._filter is None:
            return pose
        offset, turn, _ = self._filter.state.tolist()
        return compose(pose, np.array([0.0, offset, turn]))

    def _look(self, image: Image) -> ViewPose | None:
        tracker = self._tracker(self.view)
        found = tracker.locate(image, self._pose_in(self.view))
        if found is None:
            self.reason = tracker.reason
            return None
        if self._filter is None:
            return found
        point = self.route.views[self.view].path.beside(found.pose, self.way)
        off = np.abs([point.offset, point.turn] - self._filter.state[:2])
        spread = np.sqrt(np.diag(self._filter.covariance + found.covariance)[1:])
        deviation = np.array([math.sqrt(self._filter.covariance[0, 0]), spread[-1]])
        if (off > GATE * deviation + GATE_FLOOR).any() and self.lost < COASTED:
            self.reason = f'the view is {off[0]:.3f} m off what was expected'
            return None
        self.reason = ''
        return found

    def _update(self, found: ViewPose) -> PathPoint:
        """Take in where the view is; return the point on the path."""
        path = self.route.views[self.view].path
        point = path.beside(found.pose, self.way)
        heading = path.pose_at(point.way)[2]
        across = np.array([-math.sin(heading), math.cos(heading), 0.0])
        rows = np.array([across, [0.0, 0.0, 1.0]])
        covariance = rows @ found.covariance @ rows.T
        before = LateralFilter() if self._filter is None else self._filter
        self._filter = before.seen(point.offset, point.turn, covariance)
        self.way, self._curvature = point.way, point.curvature
        return point

    def _command(self, image: Image, point: PathPoint | None, dt: float) -> None:
        """Decide on the next twist."""
        settings = self.settings
        if self._filter is None or self.lost > COASTED:
            wanted = STANDSTILL
        else:
            speed = settings.max_speed if point is None else min(point.speed, settings.max_speed)
            speed = max(speed, min(0.1, settings.max_speed)) * self._confidence(point)
            speed = min(speed, brake(self.remaining - self.settings.station_distance, settings))
            speed *= self._sign
            ahead, way = self._filter, self.way
            now = self._stamp_ns or 0
            for twist, span in self._acting(now, now + round(settings.latency * 1e9)):
                state = ahead.predicted(twist.linear, twist.angular, self._curvature, span)
                ahead, way = replace(ahead, state=state), way + twist.linear * span
            way += 0.5 * speed * dt  # the command holds until the next: its middle counts
            curvature = float(
                np.interp(
                    way,
                    self.route.views[self.view].path.way,
                    self.route.views[self.view].path.curvatures,
                )
            )
            wanted = steer(ahead, curvature, speed, settings)
            if settings.steering == 'epipole':
                wanted = self._by_epipole(image, curvature, speed)
        limited = self._base.within_speed(wanted)
        self.twist = self._base.within_acceleration(limited, self.twist, dt) if dt else limited

    def _by_epipole(self, image: Image, curvature: float, speed: float) -> Twist:
        """Return the twist as taught, turned by what the epipole of the next key view is off."""
        number = self.view
        if self.route.views[number].way - self.way < NEAREST and number < self.target:
            number += 1
            tracker = self._tracker(number)
            T = relative_pose(self.route.views[number].pose, self.route.views[self.view].pose)
            tracker.locate(image, compose(T, self._pose_in(self.view)))
        view, features = self.route.views[number], self._tracker(number).features
        off = epipole_error(features, view, self.way, self.route.camera)
        return Twist(speed, speed * curvature + EPIPOLE_GAIN * (0.0 if off is None else off))

    def _confidence(self, point: PathPoint | None) -> float:
        """Return the share of the taught speed at which it is safe to go on."""
        assert self._filter is not None
        deviation = math.sqrt(self._filter.covariance[0, 0])
        off = abs(float(self._filter.state[0]))
        share = min(1.0, 3.0 * CERTAIN / max(deviation, 1e-6), 0.1 / max(off, 1e-6))
        return max(share if point is not None else 0.7 * share, 0.2)
