"""
Run on a route, a step an image: find the place, follow the path, end at the station by the servo.

Node, replay and simulation call ``step``; the words of its phases are the servo's, and
``localizing`` and ``following`` before them. Lost on the way, it stands and looks: at the key view
ahead, then at its neighbours, then anywhere on the route, and then fails with a reason.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError, TrackingError
from visual_servo_epipolar.core.estimate.odometry import WAY_SHARE
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.commands_sent import WITHDRAWN_S
from visual_servo_epipolar.core.routes.follower import (
    Confirmation,
    Follower,
    PASSED,
    RouteProgress,
    TURNED,
)
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.places import CERTAIN, Place, PlaceFinder
from visual_servo_epipolar.core.routes.route import Route, RouteView
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.admission import Arrival, FrozenImageCheck
from visual_servo_epipolar.core.servo.run import Interruption, Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.photographs import MIN_COMMON
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.observation import observe

LOCALIZING, FOLLOWING = 'localizing', 'following'
LEAST_RATIO = 0.01  # of max_speed_ratio
SEARCH_FRAMES = 5  # images between two looks at the route
NEIGHBOURS = 2  # key views on either side that are looked at first, for half of lost_timeout


class Docking:
    """
    Docking at a station, by the servo; ``features`` of the last image.

    Images are of ``camera``, photographs of the one that ``taught`` the route. The servo goes by a
    photograph alone; commands tell when what is in it was moved.
    """

    def __init__(self, camera: CameraModel, taught: CameraModel) -> None:
        self._camera, self._taught = camera, taught
        self._tracker = Tracker(TrackerSettings(), camera)
        self.features = Features()
        self._run: Run | None = None
        # By commands: in axes of the station, and since the path was left [m].
        self._pose, self._driven, self._stamp_ns = Pose(0.0, 0.0, 0.0), 0.0, 0

    @property
    def begun(self) -> bool:
        """Whether the path was left to the servo."""
        return self._run is not None

    @property
    def trouble(self) -> str:
        """That an arrival here would be elsewhere than where the way leads; or ''."""
        apart = math.hypot(self._pose.x, self._pose.y)
        if self._run is None or apart <= CERTAIN + WAY_SHARE * self._driven:
            return ''
        return (
            f'the photograph of the station looks reached {apart:.2f} m from where the way leads; '
            'look what was moved there, and teach the station anew'
        )

    def aim(self, view: RouteView) -> None:
        """Read the photographs of the station, while the robot stands: that takes a while."""
        first, *others = view.appearances
        self._tracker.set_desired(first.load())
        for each in others:
            with suppress(TrackingError):  # it serves a key view, but cannot be tied to the first
                self._tracker.add_desired(each.load())

    def begin(self, pose: FloatArray, stamp_ns: int) -> None:
        """Leave the path to the servo, at a ``pose`` in axes of the station, (3,)."""
        self._run = Run(camera=self._camera, started=True)
        self._pose, self._driven, self._stamp_ns = Pose(*pose.tolist()), 0.0, stamp_ns

    def end(self) -> None:
        """Be as before ``begin``."""
        self._run = None

    def step(
        self, image: Image, stamp_ns: int, acted: Twist, settings: ServoSettings
    ) -> ServoState:
        """Return the servo's state after an image; until it the base was sent ``acted``."""
        assert self._run is not None
        self._move(acted, stamp_ns)
        self.features = features = self._tracker.track(image)
        if self._taught != self._camera:
            desired = self._camera.pixels(self._taught.rays(features.desired))
            features = replace(features, desired=desired)
        seen = observe(features, self._camera, stamp_ns)
        self._run = self._run.decide(seen, settings, goal=features.goal).update_map()
        return self._run.state

    def halt(self, stamp_ns: int, acted: Twist, reason: str) -> None:
        """Stand from ``stamp_ns`` on, until which the base was commanded ``acted``."""
        if self._run is not None:
            self._move(acted, stamp_ns)
            self._run = self._run.interrupted(Interruption.LOST, reason)

    def _move(self, twist: Twist, stamp_ns: int) -> None:
        """Note that the base was sent a ``twist`` until ``stamp_ns``."""
        span = max(seconds_between(self._stamp_ns, stamp_ns), 0.0)
        self._driven += abs(twist.linear) * span
        self._pose, self._stamp_ns = integrate(self._pose, twist, span), stamp_ns


@dataclass(frozen=True, slots=True)
class RouteStep:
    """What an image leads to: the ``twist`` to drive, the ``phase`` and a ``reason`` for it."""

    twist: Twist
    phase: str
    reason: str = ''
    progress: RouteProgress | None = None


class RouteRun:
    """
    Run along a ``route`` to the station that ``settings`` name; ``target`` is its key view.

    Images are of ``camera``; None: of the one that taught the route. It begins at ``way`` [m], and
    wherever the robot is if that is None. Raises InputError for a station that is not there, or
    that the direction cannot reach.
    """

    def __init__(
        self,
        route: Route,
        settings: FollowSettings,
        servo: ServoSettings,
        *,
        camera: CameraModel | None = None,
        way: float | None = None,
    ) -> None:
        self.taught, self.settings = route, settings
        self.route = route if camera is None else route.seen_by(camera)
        self._limit(servo)
        self.target = target_of(route, settings)
        self._finder = PlaceFinder(self.route)
        self._follower: Follower | None = None
        self._docking = Docking(self.route.camera, route.camera)
        self._confirmed: dict[int, Confirmation] = {}
        self._searched, self._lost_ns, self.lap = 0, -1, 1
        self._newest_ns: int | None = None
        self._views = FrozenImageCheck()
        self.last = RouteStep(STANDSTILL, Phase.WAITING.value)
        if way is not None:
            self.last = self._begin_at(way)

    def use(self, settings: FollowSettings, servo: ServoSettings) -> None:
        """Go on by other settings; where it leads stays the same."""
        mine = self.settings
        self.settings = replace(
            settings, reverse=mine.reverse, station=mine.station, laps=mine.laps
        )
        self._limit(servo)
        if self._follower is not None:
            self._follower.use(self.settings, self.base, self._servo.latency)

    def _limit(self, servo: ServoSettings) -> None:
        """Take the ``servo`` of stations, and the ``base``, within the limits of the route."""
        self._servo = servo = limiting(self.settings, servo)
        limits, ratio = servo.drive.limits, servo.max_speed_ratio
        linear, angular = ratio * limits.max_linear, ratio * limits.max_angular
        limits = replace(limits, max_linear=linear, max_angular=angular)
        self.base = base_of(servo.base, limits)

    @property
    def ended(self) -> bool:
        """Whether it has arrived or failed."""
        return self.last.phase in (Phase.ARRIVED.value, Phase.FAILED.value)

    def admit(
        self, arrival: Arrival, *, max_latency: float, still_timeout: float, withheld: str = ''
    ) -> str:
        """Return why no step is taken by an image, or ''; as ``Run.admit`` of the servo."""
        self._views, trouble = self._views.admit(
            arrival,
            self._newest_ns,
            drives=self.last.twist != STANDSTILL,
            max_latency=max_latency,
            still_timeout=still_timeout,
            withheld=withheld,
            remedy='~/cancel, then ~/repeat',
        )
        return trouble

    def step(self, image: Image, stamp_ns: int) -> RouteStep:
        """Take in an image, uint8 of shape (H, W), taken at ``stamp_ns``."""
        if self.ended:
            return replace(self.last, twist=STANDSTILL)
        self._newest_ns = stamp_ns
        self._begin_docking()
        if self._docking.begun:
            self.last = self._dock(image, stamp_ns)
        elif self._follower is not None:
            self.last = self._follow(image, stamp_ns, self._follower)
        else:
            self.last = self._localize(image, stamp_ns)
        return self.last

    def prepare(self) -> None:
        """Do what no command waits for: read what the next images need."""
        self._begin_docking()
        if self._follower is not None and not self._docking.begun and not self.ended:
            self._follower.prepare()

    def halt(self, stamp_ns: int, reason: str, *, unsent: bool = False) -> RouteStep:
        """
        Stand from ``stamp_ns`` on, as no image may be driven by; the next one goes on.

        The last step was ``unsent`` where it was not sent to the base.
        """
        if self._follower is not None:
            self._follower.halt(stamp_ns, unsent=unsent)
        self._docking.halt(stamp_ns, STANDSTILL if unsent else self.last.twist, reason)
        if not self.ended:
            self.last = RouteStep(STANDSTILL, Phase.HOLDING.value, reason)
        return self.last

    def fail(self, reason: str) -> RouteStep:
        """End the run, with a reason."""
        self.last = RouteStep(STANDSTILL, Phase.FAILED.value, reason)
        return self.last

    @property
    def confirmed(self) -> int:
        """The number of key views that may be renewed."""
        return len(self._confirmed)

    def renewed(self) -> Route:
        """
        Return the route with photographs of today, after an arrival; it takes a while.

        Those of key views that were confirmed on the way, and of the station, and only where none
        of a key view's photographs is like them.
        """
        views, arrived = list(self.taught.views), self.last.phase == Phase.ARRIVED.value
        for number, seen in self._confirmed.items() if arrived else ():
            tracker = KeyViewTracker(self.route.views[number], self.route.camera)
            features = seen.features
            if number == self.target:
                tracker.locate(seen.image, np.zeros(3))
                features = tracker.features
            if len(features) >= MIN_COMMON:
                appearance = tracker.appearance(seen.image, features)
                views[number] = views[number].renewed_by(appearance, self.settings.renewals)
        return Route(self.taught.camera, tuple(views))

    def _localize(self, image: Image, stamp_ns: int) -> RouteStep:
        """Look for the robot on the route, every few images."""
        self._lost_ns = stamp_ns if self._lost_ns < 0 else self._lost_ns
        count, sign = len(self.route.views), -1.0 if self.settings.reverse else 1.0
        half = range(count // 2, count) if self.settings.reverse else range((count + 1) // 2)
        place = self._look(image, half if self.lap > 1 else None)
        if place is not None and place.view not in half and math.isfinite(self._finder.lap):
            # Where the way closes, its end may be its beginning as well.
            begin = self._finder.find(image, half)
            way = self.route.views[-1 if self.settings.reverse else 0].way
            place = begin if begin is not None and sign * (begin.way - way) > -PASSED else place
        if place is not None:
            return self._begin_at(place.way, place)
        reason = self._finder.reason
        if seconds_between(self._lost_ns, stamp_ns) > self.settings.lost_timeout:
            closes = 'needs a way that ends in sight of its beginning, or laps: 1'
            return self.fail(reason if self.lap == 1 else f'lap {self.lap} {closes}: {reason}')
        return RouteStep(STANDSTILL, LOCALIZING, reason)

    def _look(self, image: Image, among: range | None) -> Place | None:
        """Return where this image was taken, if it is looked at."""
        self._searched += 1
        return self._finder.find(image, among) if self._searched % SEARCH_FRAMES == 1 else None

    def _begin_at(self, way: float, place: Place | None = None) -> RouteStep:
        """Follow the route from a ``way`` [m] on, at a ``place`` beside it if that is known."""
        past = way - self.route.views[self.target].way
        if (-past if self.settings.reverse else past) > PASSED:
            other = _direction(replace(self.settings, reverse=not self.settings.reverse))
            return self.fail(f'the station is {abs(past):.2f} m behind; repeat the route {other}')
        turn = 0.0 if place is None else place.turn
        if abs(turn) > TURNED and not turns_in_place(self.base):
            return self.fail(
                f'the robot is turned by {math.degrees(turn):+.0f} deg to the left of the way, '
                'and its base does not turn in place; turn it to within '
                f'{math.degrees(TURNED):.0f} deg'
            )
        ahead = [k for k, view in enumerate(self.route.views) if view.way > way + PASSED and k]
        view = ahead[0] if ahead else len(self.route.views) - 1
        view = max(view, self.target + 1) if self.settings.reverse else min(view, self.target)
        self._searched = 0
        self._follower = Follower(
            self.route,
            self.settings,
            self.base,
            view=view,
            target=self.target,
            way=way,
            latency=self._servo.latency,
            place=place,
            confirmed=self._confirmed,
        )
        self._docking.aim(self.route.views[self.target])
        return RouteStep(STANDSTILL, LOCALIZING, f'found after {way:.2f} m')

    def _follow(self, image: Image, stamp_ns: int, follower: Follower) -> RouteStep:
        """Follow the path, or look for it where it is lost."""
        progress = follower.step(image, stamp_ns)
        if follower.estimate.disobeyed:
            return self.fail(follower.estimate.disobeyed)
        if follower.lost > WITHDRAWN_S:
            return self._recover(image, follower, progress)
        self._searched = 0
        return RouteStep(follower.twist, FOLLOWING, follower.reason, progress)

    def _recover(self, image: Image, follower: Follower, progress: RouteProgress) -> RouteStep:
        """Stand, and look for the route: first near where it was lost, then anywhere."""
        if follower.lost > self.settings.lost_timeout:
            return self.fail(f'lost after {progress.way:.2f} m: {follower.reason}')
        near = follower.lost < 0.5 * self.settings.lost_timeout
        first, last = follower.view - NEIGHBOURS, follower.view + NEIGHBOURS
        among = range(max(first, 0), min(last + 1, len(self.route.views))) if near else None
        place = self._look(image, among)
        if place is not None:
            return self._begin_at(place.way, place)
        return RouteStep(follower.twist, Phase.HOLDING.value, follower.reason, progress)

    def _begin_docking(self) -> None:
        """Leave the path to the servo where it is near the station, once."""
        it = self._follower
        if it is not None and it.is_there and not self._docking.begun and not self.ended:
            self._docking.begin(it.station_pose(), it.stamp_ns or 0)

    def _dock(self, image: Image, stamp_ns: int) -> RouteStep:
        """Let the servo drive to the photograph of the station."""
        state = self._docking.step(image, stamp_ns, self.last.twist, self._servo)
        if state.phase is Phase.ARRIVED and self._docking.trouble:
            return self.fail(self._docking.trouble)
        if state.phase is Phase.ARRIVED and self.settings.renewals:
            self._confirmed[self.target] = Confirmation(0.0, image, self._docking.features)
        if state.phase is Phase.ARRIVED and self.lap < self.settings.laps:
            return self._begin_lap(stamp_ns)
        twist = STANDSTILL if state.phase.ended else state.command.twist
        reason = '' if state.phase is Phase.ARRIVED else state.reason
        return RouteStep(twist, state.phase.value, reason)

    def _begin_lap(self, stamp_ns: int) -> RouteStep:
        """Look for the beginning of the way, which is in sight where it closes."""
        self.lap, self._searched, self._lost_ns = self.lap + 1, 0, stamp_ns
        self._follower = None
        self._docking.end()
        return RouteStep(STANDSTILL, LOCALIZING, f'lap {self.lap} of {self.settings.laps}')


def target_of(route: Route, settings: FollowSettings) -> int:
    """Return the number of the key view at which a run ends; InputError if there is none."""
    stations, last = route.stations, len(route.views) - 1
    begin, end = (last, 0) if settings.reverse else (0, last)
    if settings.station >= len(stations):
        raise InputError(
            f'station must be one of 0 to {len(stations) - 1} of this route, or -1, got '
            f'{settings.station}; stations are counted along the way'
        )
    target = end if settings.station < 0 else stations[settings.station]
    if target == begin:
        raise InputError(
            f'station {settings.station} is where the route begins {_direction(settings)}; name '
            'another one, or turn the direction round'
        )
    return target


def limiting(settings: FollowSettings, servo: ServoSettings) -> ServoSettings:
    """
    Return the settings of a ``servo`` with the lower of both speed limits.

    One that lies within the dead band of the base limits the mean of its pulses.
    """
    linear = max(min(servo.max_linear, settings.max_speed), servo.dead_band_linear)
    angular = max(min(servo.max_angular, settings.max_turn_rate), servo.dead_band_angular)
    ratio = min(
        servo.max_speed_ratio, settings.max_speed / linear, settings.max_turn_rate / angular
    )
    return replace(
        servo, max_linear=linear, max_angular=angular, max_speed_ratio=max(ratio, LEAST_RATIO)
    )


def refuse_heads(servo: ServoSettings) -> None:
    """Raise ValueError for a camera that a head turns."""
    if servo.carrier.turn_rate > 0.0:
        raise ValueError(
            f'routes must have a camera that is fixed to the base, got rig {servo.rig}; '
            'set rig: fixed, and hold the head still'
        )


def _direction(settings: FollowSettings) -> str:
    return 'in reverse' if settings.reverse else 'forward'
