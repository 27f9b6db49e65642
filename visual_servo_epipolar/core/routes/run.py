"""
Run on a route, a step an image: find the place, follow the path, end at the station by the servo.

Node, replay and simulation call ``step``; the words of its phases are the servo's, and
``localizing`` and ``following`` before them. Lost on the way, it stands and looks: at the key view
ahead, then at its neighbours, then anywhere on the route, and then fails with a reason.
"""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.routes.following.closing import closing_of
from visual_servo_epipolar.core.routes.following.follower import (
    COASTED,
    Confirmation,
    Follower,
    LEAST_CONFIRMED,
    PASSED,
    RouteProgress,
    TURNED,
)
from visual_servo_epipolar.core.routes.following.path_estimate import place_filter
from visual_servo_epipolar.core.routes.following.station import Docking
from visual_servo_epipolar.core.routes.following.steering import LateralFilter, LookAround
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.places import Place, PlaceFinder
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.admission import (
    Arrival,
    disorder,
    FrozenImageCheck,
    refusal,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import seconds_between

LOCALIZING, FOLLOWING = 'localizing', 'following'
WAITING, HOLDING = Phase.WAITING.value, Phase.HOLDING.value
ARRIVED, FAILED = Phase.ARRIVED.value, Phase.FAILED.value
REMEDY = '~/cancel, then ~/repeat'
LEAST_RATIO = 0.01  # of max_speed_ratio
SEARCH_FRAMES = 5  # images between two looks at the route
NEIGHBOURS = 2  # key views on either side that are looked at first, for half of lost_timeout


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
        # The end of the way, which may be its beginning, was seen by the camera that taught it.
        finder = self._finder if self.route is route else PlaceFinder(route)
        ends = self.target == (0 if settings.reverse else len(route.views) - 1)
        closing = closing_of(route, finder) if way is None or settings.laps > 1 else None
        self._finder.lap, self._finder.reason = finder.lap, finder.reason
        self._closing = closing if ends else None
        self._follower: Follower | None = None
        self._docking = Docking(self.route.camera, route.camera)
        self._confirmed: dict[int, Confirmation] = {}
        self._searched, self._lost_ns, self.lap = 0, -1, 1
        self._look_around = LookAround()
        self._newest_ns: int | None = None
        self._views = FrozenImageCheck()
        self.last = RouteStep(STANDSTILL, WAITING)
        if way is not None:
            self.last = self._begin_at(way)

    def use(self, settings: FollowSettings, servo: ServoSettings) -> None:
        """Go on by other settings; where it leads, and by which steering, stays the same."""
        self.settings = self.settings.in_mid_run(settings)
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
        return self.last.phase in (ARRIVED, FAILED)

    def admit(
        self, arrival: Arrival, *, max_latency: float, still_timeout: float, withheld: str = ''
    ) -> str:
        """Return why no step is taken by an image, or ''; as ``Run.admit`` of the servo."""
        trouble = refusal(arrival, max_latency)
        trouble = trouble or disorder(self._newest_ns, arrival.stamp_ns, REMEDY) or withheld
        if trouble:
            return trouble
        self._views = self._views.after(arrival, drives=self.last.twist != STANDSTILL)
        return self._views.trouble(still_timeout)

    def step(self, image: Image, stamp_ns: int) -> RouteStep:
        """Take in an image, uint8 of shape (H, W), taken at ``stamp_ns``."""
        if self.ended:
            return replace(self.last, twist=STANDSTILL)
        self._newest_ns = stamp_ns
        if self._follower is not None and self._follower.is_there:
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
        if self._follower is None or self.ended:
            return
        if self._follower.is_there:
            self._begin_docking()
        else:
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
            self.last = RouteStep(STANDSTILL, HOLDING, reason)
        return self.last

    def fail(self, reason: str) -> RouteStep:
        """End the run, with a reason."""
        self.last = RouteStep(STANDSTILL, FAILED, reason)
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
        views = list(self.taught.views)
        for number, seen in self._confirmed.items() if self.last.phase == ARRIVED else ():
            tracker = KeyViewTracker(self.route.views[number], self.route.camera)
            features = seen.features
            if number == self.target:
                tracker.locate(seen.image, np.zeros(3))
                features = tracker.features
            if len(features) >= LEAST_CONFIRMED:
                appearance = tracker.appearance(seen.image, features)
                views[number] = views[number].renewed_by(appearance, self.settings.renewals)
        return Route(self.taught.camera, tuple(views))

    def _localize(self, image: Image, stamp_ns: int) -> RouteStep:
        """Look for the robot on the route, every few images."""
        self._lost_ns = stamp_ns if self._lost_ns < 0 else self._lost_ns
        begin = self.route.views[-1 if self.settings.reverse else 0].way
        place = self._look(image, self._begin_of_lap, begin)
        stands = self.last.twist == STANDSTILL
        if place is not None and stands:
            return self._begin_at(place.way, place_filter(place))
        if seconds_between(self._lost_ns, stamp_ns) > self.settings.lost_timeout:
            return self.fail(self._unclosed + self._finder.reason)
        if place is not None:  # found in a turn: it is looked at once more, standing
            self._look_around, self._searched = LookAround(), 1
        elif self._finder.is_ambiguous or not stands:
            around = self._look_around.twist(stamp_ns, self.last.twist, self.base)
            return RouteStep(around, LOCALIZING, self._finder.reason)
        return RouteStep(STANDSTILL, LOCALIZING, self._finder.reason)

    @property
    def _unclosed(self) -> str:
        """What to think of where a lap is over, and its beginning is not in sight."""
        if self.lap == 1:
            return ''
        return f'lap {self.lap} needs a way that ends in sight of its beginning, or laps: 1: '

    @property
    def _begin_of_lap(self) -> range | None:
        """The key views among which a lap begins; None for the first, which may begin anywhere."""
        if self.lap == 1:
            return None
        count = len(self.route.views)
        return range(count // 2, count) if self.settings.reverse else range((count + 1) // 2)

    def _look(self, image: Image, among: range | None, near: float) -> Place | None:
        """Return where this image was taken, ``near`` a way [m], if it is looked at."""
        self._searched += 1
        if self._searched % SEARCH_FRAMES != 1:
            return None
        place = self._finder.find(image, among)
        if place is None or self._closing is None:
            return place
        return self._closing.on_lap(place, self.route.views, near)

    def _begin_at(self, way: float, at: LateralFilter | None = None) -> RouteStep:
        """Follow the route from a ``way`` [m] on, ``at`` a place beside it if that is known."""
        past = way - self.route.views[self.target].way
        if (-past if self.settings.reverse else past) > PASSED:
            other = _direction(replace(self.settings, reverse=not self.settings.reverse))
            return self.fail(f'the station is {abs(past):.2f} m behind; repeat the route {other}')
        turn = 0.0 if at is None else float(at.state[1])
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
            at=at,
            confirmed=self._confirmed,
            closing=self._closing,
            laps=self.settings.laps - self.lap,
        )
        self._docking.aim(self.route.views[self.target])
        return RouteStep(STANDSTILL, LOCALIZING, f'found after {way:.2f} m')

    def _follow(self, image: Image, stamp_ns: int, follower: Follower) -> RouteStep:
        """Follow the path, or look for it where it is lost."""
        progress = follower.step(image, stamp_ns)
        if self._closing is not None:
            self.lap = self.settings.laps - follower.laps
        if follower.disobeyed:
            return self.fail(follower.disobeyed)
        if follower.lost > COASTED:
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
        place = self._look(image, among, progress.way)
        if place is not None:
            return self._begin_at(place.way, place_filter(place))
        return RouteStep(follower.twist, HOLDING, follower.reason, progress)

    def _begin_docking(self) -> None:
        """Leave the path to the servo, once."""
        if not self._docking.begun and self._follower is not None:
            self._docking.begin(self._follower.station_pose(), self._follower.stamp_ns)

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
