"""
Following: the taught path, by one image after the other.

The robot is placed in the structure of the key view ahead, and beside the path as that structure
shows it. Where a key view is reached, the next takes over: what both say differs by the seam,
which a filter spreads over some steps.
"""

from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.bases.base import Base, turns_in_place
from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.estimate.goal_estimate import USUAL_STEP_S
from visual_servo_epipolar.core.geometry.motion import compose, relative_pose, STANDSTILL, Twist
from visual_servo_epipolar.core.routes.following.closing import Closing
from visual_servo_epipolar.core.routes.following.path_estimate import (
    beside,
    PathEstimate,
    PathMeasurement,
)
from visual_servo_epipolar.core.routes.following.steering import (
    brake,
    epipole_error,
    EPIPOLE_GAIN,
    LateralFilter,
    NEAREST,
    steer,
    turned_back,
)
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.route import Route, RouteView
from visual_servo_epipolar.core.routes.settings import EPIPOLE, FollowSettings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.features import Features

COASTED = 0.5  # time without a trusted view after which it stands [s]
CERTAIN = 0.01  # a third of the deviation of the offset that slows it down [m]
SLOWEST = 0.1  # that it drives where it was taught slower [m/s]
PASSED = 0.05  # way by which a key view counts as passed [m]
TURNED = 0.8  # from the heading of the path, from which a base that can turns in place [rad]
TURNED_BACK = 0.1  # where it turns in place as taught, with nothing in sight [rad]
CONFIRMED_NEAR, LEAST_CONFIRMED = 0.06, 30  # of a key view that is confirmed: away [m], inliers
MOST_CONFIRMED = 200  # images that are kept for this


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


class Confirmation(NamedTuple):
    """An image near a key view that was placed by it: how far away [m], and its features there."""

    away: float
    image: Image
    features: Features


FAR = Confirmation(math.inf, np.empty((0, 0), np.uint8), Features())


class Follower:
    """
    Follows a route from ``way`` [m] and key view ``view`` on, to ``target``: a step an image.

    In reverse it drives backward, seeing what was seen when the way was taught. ``latency`` [s]
    is the delay from an image to the motion that it leads to. ``at`` is where beside the path it
    begins, if that is known. With ``closing`` it goes on at the other end of the way for so many
    ``laps`` more.

    ``is_there``: so near before the target that the servo takes over. ``lost`` [s] is the time
    without a view that was believed, ``reason`` says why. ``confirmed`` are key views that look
    otherwise than their photographs, where ``settings`` want them renewed.
    """

    def __init__(
        self,
        route: Route,
        settings: FollowSettings,
        base: Base,
        *,
        view: int,
        target: int,
        way: float,
        latency: float,
        at: LateralFilter | None = None,
        confirmed: dict[int, Confirmation] | None = None,
        closing: Closing | None = None,
        laps: int = 0,
    ) -> None:
        self.route, self.settings, self._base = route, settings, base
        self.view, self.target = view, target
        self._sign = -1 if settings.reverse else 1
        self._closing, self.laps = closing, 0 if closing is None else laps
        self._views = self._lap_views(entered=False)
        self._estimate = PathEstimate(way, latency, at)
        self.lost, self.reason, self._turns = 0.0, '', False
        self._trackers: dict[int, KeyViewTracker] = {}
        self.confirmed = {} if confirmed is None else confirmed
        self._stamp_ns: int | None = None
        self.limiter = Limiter()

    def use(self, settings: FollowSettings, base: Base, latency: float) -> None:
        """Go on by other settings, and with other limits of the base."""
        self.settings, self._base, self._estimate.latency = settings, base, latency

    @property
    def twist(self) -> Twist:
        """Velocity that the last image led to."""
        return self.limiter.last

    @property
    def stamp_ns(self) -> int:
        """Stamp of the last image; 0 before the first."""
        return self._stamp_ns or 0

    @property
    def way(self) -> float:
        """Way that it has come along the route [m]."""
        return self._estimate.way

    @property
    def disobeyed(self) -> str:
        """That the base does not do as commanded; or ''."""
        return self._estimate.disobeyed

    @property
    def remaining(self) -> float:
        """Way that is left to the target [m]."""
        left = self._sign * (self.route.views[self.target].way - self.way)
        return left + (self.laps * self._closing.length if self._closing is not None else 0.0)

    @property
    def is_there(self) -> bool:
        """Whether the servo is to take over."""
        return self._is_last and self.remaining <= self.settings.station_distance

    def _lap_views(self, *, entered: bool) -> tuple[RouteView, ...]:
        """Return the key views as this lap goes by them, ``entered`` by the closing or not."""
        left, views = self.laps > 0, self.route.views
        if self._closing is None:
            return views
        begin, end = (entered, left) if self._sign > 0 else (left, entered)
        return self._closing.lap(views, begin=begin, end=end)

    @property
    def _is_last(self) -> bool:
        """Whether no key view follows: backward, what lies behind one is seen in the one ahead."""
        return not self.laps and self.view == (self.target if self._sign > 0 else self.target + 1)

    @property
    def _next(self) -> tuple[int, bool]:
        """The key view that follows, and whether it is that of the next lap."""
        if self.laps and self._closing is not None:
            views, way = self.route.views, self._closing.way
            if self._sign > 0 and self.view == len(views) - 1:
                return next(k for k, it in enumerate(views) if k and it.way > way + PASSED), True
            if self._sign < 0 and (self.view == 1 or views[self.view - 1].way < way):
                return len(views) - 1, True
        return self.view + self._sign, False

    def step(self, image: Image, stamp_ns: int) -> RouteProgress:
        """Take in an image, uint8 of shape (H, W); ``twist`` is then what to drive."""
        before_ns = stamp_ns if self._stamp_ns is None else self._stamp_ns
        dt = seconds_between(before_ns, stamp_ns)
        self._estimate.predict(before_ns, stamp_ns)
        self._stamp_ns = stamp_ns
        if self._estimate.lateral is not None:
            self._turns &= abs(float(self._estimate.lateral.state[1])) > TURNED_BACK
        switched = self._switch(image)
        found = self._look(image)
        self.lost = 0.0 if found is not None or self._is_bridged else self.lost + dt
        if found is not None:
            self._estimate.update(found)
            self._confirm(image, found)
        wanted, lateral = STANDSTILL, self._estimate.lateral
        if lateral is not None and self.lost <= COASTED:
            wanted = self._wanted(image, lateral, found, dt)
        self.limiter = self.limiter.after(
            wanted, self.limiter.ramp_step(dt, USUAL_STEP_S), self._base
        )
        self._estimate.sent(stamp_ns, self.twist)
        return self._progress(found, switched)

    @property
    def _is_bridged(self) -> bool:
        """Whether it drives by its commands: in a turn on the spot, or by the odometry's way."""
        view, at = self._views[self.view], self._estimate.lateral
        if view.bridge is None or at is None:
            return self._turns
        begin = float(view.path.way[0]) - PASSED
        return self._turns or begin < self.way < begin + view.bridge.way + 2.0 * PASSED

    def prepare(self) -> None:
        """Read the key view after the one ahead, so that no image has to wait for it."""
        if not self._is_last:
            self._tracker(self._next[0])
        passed = self.view - self._sign
        if passed in self.confirmed and not self._looks_new(passed):
            del self.confirmed[passed]

    def _looks_new(self, view: int) -> bool:
        """Return whether none of its photographs shows a key view as it was confirmed."""
        known, (_, image, features) = self.route.views[view], self.confirmed[view]
        pixels, rows, most = features.current, features.ids, self.settings.renewals
        return known.superfluous(image, pixels, rows, most) != len(known.appearances)

    def _confirm(self, image: Image, found: PathMeasurement) -> None:
        """Remember an image that was taken where the key view ahead was."""
        away = abs(self.way - self.route.views[self.view].way)
        is_full = len(self.confirmed) >= MOST_CONFIRMED and self.view not in self.confirmed
        if not self.settings.renewals or is_full or found.inliers < LEAST_CONFIRMED:
            return
        if away < min(CONFIRMED_NEAR, self.confirmed.get(self.view, FAR).away):
            features = self._tracker(self.view).features
            self.confirmed[self.view] = Confirmation(away, image, features)

    def halt(self, stamp_ns: int, *, unsent: bool) -> None:
        """Note a command to stand at ``stamp_ns``; the last twist was ``unsent``."""
        self.limiter = Limiter()
        self._estimate.halted(stamp_ns, unsent=unsent)

    def station_pose(self) -> FloatArray:
        """Return the pose in axes of the target, (3,), at the last image."""
        views = self.route.views
        T_target_view = relative_pose(views[self.target].pose, views[self.view].pose)
        return compose(T_target_view, self._pose_in(self.view))

    def _progress(self, found: PathMeasurement | None, switched: bool) -> RouteProgress:
        it = self._estimate.lateral or LateralFilter()
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

    def _tracker(self, view: int) -> KeyViewTracker:
        if view not in self._trackers:
            self._trackers[view] = KeyViewTracker(self.route.views[view], self.route.camera)
        return self._trackers[view]

    @property
    def _border(self) -> float:
        """The way at which the key view ahead is reached [m]."""
        return self.route.views[self.view if self._sign > 0 else self.view - 1].way

    def _switch(self, image: Image) -> bool:
        """Go on to the next key view where this one is reached and that one is seen."""
        border, (number, closes) = self._border, self._next
        if closes and self._closing is not None and self._sign < 0:
            border = self._closing.way
        if self._is_last or self._turns or self._sign * (border - self.way) > 0.0:
            return False
        following = self._tracker(number)
        if closes:
            self._close(number)
        else:
            T = relative_pose(self._views[number].pose, self._views[self.view].pose)
            pose = compose(T, self._pose_in(self.view))
            self._turn(number, pose)
            if not following.begun:
                following.begin(image, pose)
        self._trackers.pop(self.view, None)
        self.view = number
        return True

    def _turn(self, number: int, pose: FloatArray) -> None:
        """Go on beside the path of a key view where the way turns, or the odometry had it."""
        bridge, at = self._views[max(number, self.view)].bridge, self._estimate.lateral
        self._turns = self._turns_before(number)
        if at is not None and (self._turns or bridge is not None):
            self._estimate.continued(self._views[number].path.beside(pose, self.way), bridge)

    def _turns_before(self, number: int) -> bool:
        """Whether the way turns on the spot between the key view ahead and that ``number``."""
        here, there = self._views[self.view], self._views[number]
        border = (here if self._sign > 0 else there).way
        ahead = compose(relative_pose(there.pose, here.pose), here.path.pose_at(border))
        turn = float(ahead[2] - there.path.pose_at(border)[2])
        return abs(math.remainder(turn, 2.0 * math.pi)) > TURNED_BACK

    def _close(self, number: int) -> None:
        """Begin the next lap, by the key view of that ``number``."""
        assert self._closing is not None
        T = self._closing.transform(self.route.views, self.view, number)
        path = self._views[self.view].path
        self.laps -= 1
        self._views = self._lap_views(entered=True)
        self._estimate.carried(
            T, path, self._views[number].path, -self._sign * self._closing.length
        )

    def _pose_in(self, view: int) -> FloatArray:
        """Return the pose in axes of a key view, (3,)."""
        return self._estimate.pose_in(self._views[view].path)

    def _look(self, image: Image) -> PathMeasurement | None:
        """Return where the view is beside the path; None, and why, if that is not believed."""
        tracker, path = self._tracker(self.view), self._views[self.view].path
        found = tracker.locate(image, self._pose_in(self.view))
        if found is None:
            self.reason = tracker.reason
            return None
        measured = beside(path, found, self.way)
        self.reason = self._estimate.trouble(measured)
        tracker.begun = not self.reason  # the features are elsewhere: look where they must be
        return None if self.reason else measured

    def _wanted(
        self, image: Image, at: LateralFilter, found: PathMeasurement | None, dt: float
    ) -> Twist:
        """Return the twist that is wanted next, whatever the base can follow of it."""
        settings, limits = self.settings, self._base.limits
        most = TURNED_BACK if self._turns else TURNED
        if abs(at.state[1]) > most and turns_in_place(self._base):
            return turned_back(float(at.state[1]), limits.max_angular_acceleration)
        taught = limits.max_linear if found is None else max(found.point.speed, SLOWEST)
        speed = min(taught, limits.max_linear)
        speed *= confidence(at, self.lost)
        left = self.remaining - settings.station_distance
        if not self._is_last and not self._next[1] and self._turns_before(self._next[0]):
            left = min(left, self._sign * (self._border - self.way))
        speed = self._sign * min(speed, brake(left, limits.max_acceleration))
        if dt:  # it turns by the speed that it can have: the curve stays the same
            aim = replace(self.twist, linear=speed)
            ramp_s = self.limiter.ramp_step(dt, USUAL_STEP_S)
            speed = self.limiter.within_limits(aim, ramp_s, self._base).linear
        at, way = self._estimate.when_told(at, self.stamp_ns)
        way += 0.5 * speed * dt  # the command holds until the next: its middle counts
        curvature = self._views[self.view].path.curvature_at(way)
        if settings.steering == EPIPOLE:
            return self._by_epipole(image, curvature, speed)
        return steer(at, curvature, speed, settings)

    def _by_epipole(self, image: Image, curvature: float, speed: float) -> Twist:
        """Return the twist as taught, turned by what the epipole of the next key view is off."""
        number = self.view
        if self.route.views[number].way - self.way < NEAREST and number < self.target:
            number += 1
            tracker = self._tracker(number)
            T = relative_pose(self.route.views[number].pose, self.route.views[self.view].pose)
            tracker.locate(image, compose(T, self._pose_in(self.view)))
        view, features = self._views[number], self._tracker(number).features
        off = epipole_error(features, view, self.way, self.route.camera)
        return Twist(speed, speed * curvature + EPIPOLE_GAIN * (0.0 if off is None else off))


def confidence(at: LateralFilter, lost: float) -> float:
    """Return the share of the taught speed at which it is safe to go on, ``lost`` for a time."""
    deviation, off = math.sqrt(at.covariance[0, 0]), abs(float(at.state[0]))
    share = min(1.0, 3.0 * CERTAIN / max(deviation, 1e-6), 0.1 / max(off, 1e-6))
    # By and by: a single image without a view is no reason to turn less at once.
    return max(share * (1.0 - 0.6 * min(lost / COASTED, 1.0)), 0.2)
