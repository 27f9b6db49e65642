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
from visual_servo_epipolar.core.estimate.odometry import COMMANDED_WAY
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING
from visual_servo_epipolar.core.geometry.motion import compose, relative_pose, STANDSTILL, Twist
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent, WITHDRAWN_S
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.path import PathPoint, TaughtPath
from visual_servo_epipolar.core.routes.places import Place
from visual_servo_epipolar.core.routes.route import Bridge, MOST_IMAGES, Route
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.routes.structure import ViewPose
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.photographs import MIN_COMMON

GATE_FLOOR = np.array([0.02, 0.02, 0.01])  # that they are at least [m, m, rad]
SLIP_NOISE = 0.03  # of the true way against the commanded one [m/sqrt(m)]
PLACE_NOISE = np.array([0.02, 0.02, 0.02])  # of way, offset and turn of a place [m, m, rad]
LEAST_OBEYED = 0.2  # share of a way of commands that the view must see
TURN_NOISE = 0.02  # of the true turn against the commanded one [rad/sqrt(s)]
SLIDE_NOISE = 0.002  # of the base across its heading [m/sqrt(m)]
FIRST = np.diag([0.3**2, 0.3**2, 0.03**2])
LEAST = np.array([0.0015, 0.0006])  # deviations of one view beside its own: the seam [m, rad]
CERTAIN = 0.01  # a third of the deviation of the offset that slows it down [m]
SLOWEST = 0.1  # that it drives where it was taught slower [m/s]
PASSED = 0.05  # way by which a key view counts as passed [m]
TURNED = 0.8  # from the heading of the path, from which a base that can turns in place [rad]
TURNED_BACK = 0.1  # where it turns in place as taught, with nothing in sight [rad]
CONFIRMED_NEAR = 0.06  # from a key view that is confirmed [m]
CRAWL = 0.05  # speed at which a station is come near [m/s]


class PathMeasurement(NamedTuple):
    """Where a view is beside the path, with the covariance, (3, 3), of way, offset and turn."""

    point: PathPoint
    covariance: FloatArray
    inliers: int


class PathEstimate:
    """
    Where on the ``way`` [m] and beside the path a robot is: a filter of commands and views.

    ``state``, (3,): offset to the left [m], turn to the left [rad], and the curvature that the
    base adds to what is commanded [1/m], with ``covariance``, (3, 3). It begins at a ``place``, or
    unsure (``is_placed``) until a view tells. Commands act after ``latency`` [s]; ``disobeyed``
    says that the base does not do as commanded.
    """

    def __init__(self, way: float, latency: float, place: Place | None = None) -> None:
        self.way, self.latency, self.disobeyed = way, latency, ''
        self.state, self.covariance, self.is_placed = np.zeros(3), FIRST.copy(), place is not None
        if place is not None:
            self.state[:2] = place.offset, place.turn
            squares = np.array([place.deviation**2, place.pose.covariance[2, 2]])
            self.covariance[:2, :2] = np.diag(PLACE_NOISE[1:] ** 2 + squares)
        self._commanded, self._marked = 0.0, way  # since the base was last seen to obey [m]
        # Where a view was believed at last, and what is unsure since then.
        self._seen_way, self.way_variance = way, float(PLACE_NOISE[0] ** 2)
        self._sent = CommandsSent()
        self._curvature = 0.0

    @property
    def deviation(self) -> float:
        """Deviation of the offset [m]."""
        return math.sqrt(self.covariance[0, 0])

    def sent(self, stamp_ns: int, twist: Twist) -> None:
        """Note that the base was sent a ``twist`` at ``stamp_ns``."""
        self._sent = self._sent.after(stamp_ns, twist)

    def halted(self, stamp_ns: int, *, unsent: bool) -> None:
        """Note a command to stand at ``stamp_ns``; the last twist was ``unsent``."""
        if unsent or self._sent.stamps[-1:] == (stamp_ns,):  # it does not act at all
            self._sent = CommandsSent(self._sent.stamps[:-1], self._sent.twists[:-1])
        self.sent(stamp_ns, STANDSTILL)

    def continued(self, point: PathPoint, bridge: Bridge | None) -> None:
        """Go on at a ``point`` beside another path, to which a ``bridge`` leads, if any."""
        if bridge is not None:
            self.covariance += np.diag([bridge.deviation**2, bridge.turn_deviation**2, 0.0])
        self.way, self.state = point.way, np.array([point.offset, point.turn, self.state[2]])

    def pose_in(self, path: TaughtPath) -> FloatArray:
        """Return the pose in axes of the key view of a ``path``, (3,)."""
        offset, turn, _ = self.state.tolist()
        return compose(path.pose_at(self.way), np.array([0.0, offset, turn]))

    def predict(self, start_ns: int, end_ns: int) -> None:
        """Move on by what the base was commanded between two images."""
        if self.is_placed and end_ns > start_ns:
            for span, twist in self._sent.acting(start_ns, end_ns, self.latency):
                self.move(twist, span)

    def move(self, twist: Twist, dt: float) -> None:
        """Move on by a ``twist`` for ``dt`` [s]."""
        way = twist.linear * dt
        slope = np.array([[1.0, way, 0.5 * way * way], [0.0, 1.0, way], [0.0, 0.0, 1.0]])
        drift = DriveSettings.curvature_drift
        noise = np.array([SLIDE_NOISE**2 * abs(way), TURN_NOISE**2 * dt, drift**2 * abs(way)])
        self.covariance = slope @ self.covariance @ slope.T + np.diag(noise)
        self.state = self._moved(self.state, twist, dt)
        self.way += way
        self._commanded += abs(way)
        self.way_variance += SLIP_NOISE**2 * abs(way)

    def _moved(self, state: FloatArray, twist: Twist, dt: float) -> FloatArray:
        offset, turn, bias = state.tolist()
        rate = twist.angular + twist.linear * (bias - self._curvature)
        middle = turn + 0.5 * rate * dt
        return np.array([offset + twist.linear * math.sin(middle) * dt, turn + rate * dt, bias])

    def when_told(self, now_ns: int) -> tuple[FloatArray, float]:
        """Return the state and the way when the next command begins to act."""
        state, way, late_ns = self.state, self.way, round(self.latency * NANOSECONDS)
        for span, twist in self._sent.acting(now_ns, now_ns + late_ns, self.latency):
            state, way = self._moved(state, twist, span), way + twist.linear * span
        return state, way

    def trouble(self, measured: PathMeasurement) -> str:
        """Return that a view is farther off what was predicted than chance explains; or ''."""
        if not self.is_placed:  # a robot that was carried away is looked for anew
            return ''
        point, (offset, turn, _) = measured.point, self.state.tolist()
        # It may have driven less than commanded: that is for ``disobeyed``.
        least, most = sorted((self._seen_way, self.way))
        slip = point.way - min(max(point.way, least), most)
        off = np.array([slip, point.offset - offset, point.turn - turn])
        covariance = measured.covariance + np.diag(GATE_FLOOR**2 / CONTRADICTING)
        covariance[0, 0] += self.way_variance
        covariance[1:, 1:] += self.covariance[:2, :2]
        if float(off @ np.linalg.solve(covariance, off)) <= CONTRADICTING:
            return ''
        return (
            f'the view is {off[0]:+.3f} m along the way, {off[1]:+.3f} m beside it and '
            f'{off[2]:+.3f} rad off what was predicted, {math.sqrt(CONTRADICTING):g} deviations '
            'are believed'
        )

    def update(self, measured: PathMeasurement) -> None:
        """Take in where a view that is believed is."""
        point, noise = measured.point, measured.covariance[1:, 1:] + np.diag(LEAST**2)
        gain = self.covariance[:, :2] @ np.linalg.inv(self.covariance[:2, :2] + noise)
        self.state = self.state + gain @ (np.array([point.offset, point.turn]) - self.state[:2])
        after = self.covariance - gain @ self.covariance[:2]
        self.covariance, self.is_placed = 0.5 * (after + after.T), True
        self.way, self._curvature = point.way, point.curvature
        self._seen_way, self.way_variance = point.way, 0.0
        if self._commanded > COMMANDED_WAY:
            moved = abs(self.way - self._marked)
            if moved < LEAST_OBEYED * self._commanded:
                self.disobeyed = (
                    f'the base was commanded to drive {self._commanded:.2f} m, and the view has '
                    f'moved by {moved:.2f} m; look at its wheels, and for others on cmd_vel'
                )
            self._commanded, self._marked = 0.0, self.way


def beside(path: TaughtPath, found: ViewPose, near: float) -> PathMeasurement:
    """Return where a placed view is beside a ``path``, not far from ``near`` [m] on it."""
    point = path.beside(found.pose, near)
    heading = path.pose_at(point.way)[2]
    cos, sin = math.cos(heading), math.sin(heading)
    rows = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return PathMeasurement(point, rows @ found.covariance @ rows.T, found.inliers)


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


class Follower:
    """
    Follows a route from ``way`` [m] and key view ``view`` on, to ``target``: a step an image.

    In reverse it drives backward, seeing what was seen when the way was taught. ``latency`` [s]
    is the delay from an image to the motion that it leads to. It begins at a ``place``, if that is
    known.

    ``estimate`` is where it is. ``is_there``: so near before the target that the servo takes over.
    ``lost`` [s] is the time without a view that was believed, ``reason`` says why. ``confirmed``
    are key views that look otherwise than their photographs, where ``settings`` want them renewed.
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
        place: Place | None = None,
        confirmed: dict[int, Confirmation] | None = None,
    ) -> None:
        self.route, self.settings, self._base = route, settings, base
        self.view, self.target = view, target
        self._sign = -1 if settings.reverse else 1
        self.estimate = PathEstimate(way, latency, place)
        self.lost, self.reason, self._turns = 0.0, '', False
        self._trackers: dict[int, KeyViewTracker] = {}
        self.confirmed = {} if confirmed is None else confirmed
        self.stamp_ns: int | None = None  # of the last image
        self.limiter = Limiter()

    def use(self, settings: FollowSettings, base: Base, latency: float) -> None:
        """Go on by other settings, and with other limits of the base."""
        self.settings, self._base, self.estimate.latency = settings, base, latency

    @property
    def twist(self) -> Twist:
        """Velocity that the last image led to."""
        return self.limiter.last

    @property
    def remaining(self) -> float:
        """Way that is left to the target [m]."""
        return self._sign * (self.route.views[self.target].way - self.estimate.way)

    @property
    def is_there(self) -> bool:
        """Whether the servo is to take over."""
        return self._is_last and self.remaining <= self.settings.station_distance

    @property
    def _is_last(self) -> bool:
        """Whether no key view follows: backward, what lies behind one is seen in the one ahead."""
        return self.view == (self.target if self._sign > 0 else self.target + 1)

    @property
    def _next(self) -> int:
        """The key view that follows."""
        return self.view + self._sign

    def step(self, image: Image, stamp_ns: int) -> RouteProgress:
        """Take in an image, uint8 of shape (H, W); ``twist`` is then what to drive."""
        before_ns = stamp_ns if self.stamp_ns is None else self.stamp_ns
        self.stamp_ns = stamp_ns
        dt = seconds_between(before_ns, stamp_ns)
        self.estimate.predict(before_ns, stamp_ns)
        self._turns &= abs(float(self.estimate.state[1])) > TURNED_BACK
        switched = self._switch(image)
        found = self._look(image)
        self.lost = 0.0 if found is not None or self._is_bridged else self.lost + dt
        if found is not None:
            self.estimate.update(found)
            self._confirm(image, found)
        drives = self.estimate.is_placed and self.lost <= WITHDRAWN_S
        wanted = self._wanted(found, dt) if drives else STANDSTILL
        self.limiter = self.limiter.after(
            wanted, self.limiter.ramp_step(dt, USUAL_STEP_S), self._base
        )
        self.estimate.sent(stamp_ns, self.twist)
        return RouteProgress(
            self.view,
            self.estimate.way,
            self.remaining,
            float(self.estimate.state[0]),
            self.estimate.deviation,
            float(self.estimate.state[1]),
            0 if found is None else found.inliers,
            switched,
        )

    @property
    def _is_bridged(self) -> bool:
        """Whether it drives by its commands: in a turn on the spot, or by the odometry's way."""
        view = self.route.views[self.view]
        if view.bridge is None or not self.estimate.is_placed:
            return self._turns
        begin = float(view.path.way[0]) - PASSED
        return self._turns or begin < self.estimate.way < begin + view.bridge.way + 2.0 * PASSED

    def prepare(self) -> None:
        """Read the key view after the one ahead, so that no image has to wait for it."""
        if not self._is_last:
            self._tracker(self._next)
        passed = self.view - self._sign
        if passed in self.confirmed:  # it is kept where no photograph shows it as it looks today
            known, (_, image, features) = self.route.views[passed], self.confirmed[passed]
            pixels, rows, most = features.current, features.ids, self.settings.renewals
            if known.superfluous(image, pixels, rows, most) == len(known.appearances):
                del self.confirmed[passed]

    def _confirm(self, image: Image, found: PathMeasurement) -> None:
        """Remember an image that was taken where the key view ahead was."""
        away = abs(self.estimate.way - self.route.views[self.view].way)
        before = self.confirmed.get(self.view)
        is_full = len(self.confirmed) >= MOST_IMAGES and before is None
        if not self.settings.renewals or is_full or found.inliers < MIN_COMMON:
            return
        if away < (CONFIRMED_NEAR if before is None else before.away):
            features = self._tracker(self.view).features
            self.confirmed[self.view] = Confirmation(away, image, features)

    def halt(self, stamp_ns: int, *, unsent: bool) -> None:
        """Note a command to stand at ``stamp_ns``; the last twist was ``unsent``."""
        self.limiter = Limiter()
        self.estimate.halted(stamp_ns, unsent=unsent)

    def station_pose(self) -> FloatArray:
        """Return the pose in axes of the target, (3,), at the last image."""
        return compose(self._transform(self.target), self._pose)

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
        number = self._next
        if self._is_last or self._turns or self._sign * (self._border - self.estimate.way) > 0.0:
            return False
        following, T = self._tracker(number), self._transform(number)
        pose = compose(T, self._pose)
        self._turn(number, pose)
        if not following.begun:
            following.begin(image, pose)
        self._trackers.pop(self.view, None)
        self.view = number
        return True

    def _transform(self, number: int) -> FloatArray:
        """Return the pose of the key view ahead in axes of that ``number``, (3,)."""
        return relative_pose(self.route.views[number].pose, self.route.views[self.view].pose)

    def _turn(self, number: int, pose: FloatArray) -> None:
        """Go on beside the path of a key view where the way turns, or the odometry had it."""
        bridge = self.route.views[max(number, self.view)].bridge
        self._turns = self._turns_before(number)
        if self.estimate.is_placed and (self._turns or bridge is not None):
            self.estimate.continued(
                self.route.views[number].path.beside(pose, self.estimate.way), bridge
            )

    def _turns_before(self, number: int) -> bool:
        """Whether the way turns on the spot between the key view ahead and that ``number``."""
        here, there = self.route.views[self.view], self.route.views[number]
        border = (here if self._sign > 0 else there).way
        ahead = compose(self._transform(number), here.path.pose_at(border))
        turn = float(ahead[2] - there.path.pose_at(border)[2])
        return abs(math.remainder(turn, 2.0 * math.pi)) > TURNED_BACK

    @property
    def _pose(self) -> FloatArray:
        """The pose in axes of the key view ahead, (3,)."""
        return self.estimate.pose_in(self.route.views[self.view].path)

    def _look(self, image: Image) -> PathMeasurement | None:
        """Return where the view is beside the path; None, and why, if that is not believed."""
        tracker, path = self._tracker(self.view), self.route.views[self.view].path
        found = tracker.locate(image, self._pose)
        if found is None:
            self.reason = tracker.reason
            return None
        measured = beside(path, found, self.estimate.way)
        self.reason = self.estimate.trouble(measured)
        tracker.begun = not self.reason  # the features are elsewhere: look where they must be
        return None if self.reason else measured

    def _wanted(self, found: PathMeasurement | None, dt: float) -> Twist:
        """Return the twist that is wanted next, whatever the base can follow of it."""
        settings, limits = self.settings, self._base.limits
        offset, turn, _ = self.estimate.state.tolist()
        most = TURNED_BACK if self._turns else TURNED
        if abs(turn) > most and turns_in_place(self._base):
            rate = math.sqrt(limits.max_angular_acceleration * abs(turn))  # at half of it
            return Twist(0.0, -math.copysign(rate, turn))
        taught = limits.max_linear if found is None else max(found.point.speed, SLOWEST)
        speed = min(taught, limits.max_linear)
        speed *= confidence(offset, self.estimate.deviation, self.lost)
        left = self.remaining - settings.station_distance
        if not self._is_last and self._turns_before(self._next):
            left = min(left, self._sign * (self._border - self.estimate.way))
        speed = self._sign * min(speed, brake(left, limits.max_acceleration))
        if dt:  # it turns by the speed that it can have: the curve stays the same
            aim = replace(self.twist, linear=speed)
            ramp_s = self.limiter.ramp_step(dt, USUAL_STEP_S)
            speed = self.limiter.within_limits(aim, ramp_s, self._base).linear
        state, way = self.estimate.when_told(self.stamp_ns or 0)
        way += 0.5 * speed * dt  # the command holds until the next: its middle counts
        curvature = self.route.views[self.view].path.curvature_at(way)
        return steer(state, curvature, speed, settings)


def confidence(offset: float, deviation: float, lost: float) -> float:
    """Return the share of the taught speed at which it is safe to go on, ``lost`` for a time."""
    share = min(1.0, 3.0 * CERTAIN / max(deviation, 1e-6), 0.1 / max(abs(offset), 1e-6))
    # By and by: a single image without a view is no reason to turn less at once.
    return max(share * (1.0 - 0.6 * min(lost / WITHDRAWN_S, 1.0)), 0.2)


def steer(state: FloatArray, curvature: float, speed: float, settings: FollowSettings) -> Twist:
    """
    Return the twist that brings an offset and a turn to zero along the way.

    With s the way driven, e the offset and t the turn, e' = t and t' = k - k_path: the curvature
    k = k_path - 2 t / L - e / L^2 makes e'' + 2 e' / L + e / L^2 = 0, which is damped critically,
    whatever the speed. Beyond one steering length L the way back to the path is straight. Driving
    backward turns the sign of s, and with it that of the middle term.
    """
    offset, turn, bias = state.tolist()
    length, forward = settings.steering_length, math.copysign(1.0, speed)
    share = max(min(offset / length, 1.0), -1.0)
    wanted = curvature - bias - 2.0 * forward * turn / length - share / length
    return Twist(speed, speed * wanted)


def brake(way: float, acceleration: float) -> float:
    """Return the speed from which half of it stops within ``way`` [m], not below a crawl."""
    return max(math.sqrt(acceleration * max(way, 0.0)), CRAWL)
