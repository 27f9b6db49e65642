"""
Run on a route, a step an image: find the place, follow the path, end at the station by the servo.

Node, replay and simulation call ``step``; the words of its phases are the servo's, and
``localizing`` and ``following`` before them.
"""

from dataclasses import dataclass, replace

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.bases.base import Base
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.routes.following import Follower, RouteProgress
from visual_servo_epipolar.core.routes.places import PlaceFinder
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.session import Session
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker

LOCALIZING, FOLLOWING = 'localizing', 'following'
ARRIVED, FAILED = Phase.ARRIVED.value, Phase.FAILED.value
SEARCH_FRAMES = 5  # images between two looks at the whole route
PASSED = 0.05  # way by which a key view counts as passed [m]


@dataclass(frozen=True, slots=True)
class RouteStep:
    """What an image leads to: the ``twist`` to drive, the ``phase`` and a ``reason`` for it."""

    twist: Twist
    phase: str
    reason: str
    progress: RouteProgress | None


class RouteRun:
    """
    Run along a ``route`` to the station at key view ``target``, by default that at its end.

    It begins at ``way`` [m] where that is known, and wherever the robot is if it is None. In
    reverse it drives backward, and the end is the first station. Raises InputError for a target
    that the direction cannot reach.
    """

    def __init__(
        self,
        route: Route,
        settings: FollowSettings,
        servo: ServoSettings,
        *,
        target: int | None = None,
        way: float | None = None,
    ) -> None:
        self.route, self.settings, self._servo = route, settings, servo
        ends = 0, len(route.views) - 1
        begin, end = ends[::-1] if settings.reverse else ends
        self.target = end if target is None else target
        if self.target == begin or not 0 <= self.target <= ends[1]:
            raise InputError(
                f'a route {_direction(settings)} must end at one of the key views 0 to {ends[1]} '
                f'other than {begin}, where it begins, got {self.target}; name another station, '
                'or turn the direction round'
            )
        self.base = _base(settings, servo)
        self._finder = PlaceFinder(route)
        self._follower: Follower | None = None
        self._session: Session | None = None
        self._tracker: Tracker | None = None
        self._searched, self._lost_ns, self._ended = 0, -1, ''
        self._reason = ''
        if way is not None:
            self._begin_at(way)

    @property
    def ended(self) -> bool:
        """Whether it has arrived or failed."""
        return bool(self._ended)

    def step(self, image: Image, stamp_ns: int) -> RouteStep:
        """Take in an image, uint8 of shape (H, W), taken at ``stamp_ns``."""
        if self._ended:
            return RouteStep(STANDSTILL, self._ended, self._reason, None)
        if self._session is not None:
            return self._dock(image, stamp_ns, self._session)
        if self._follower is None:
            return self._localize(image, stamp_ns)
        progress = self._follower.step(image, stamp_ns)
        if self._follower.lost > self.settings.lost_timeout:
            return self._end(FAILED, f'lost after {progress.way:.2f} m: {self._follower.reason}')
        if self._follower.is_there:
            self._begin_docking()
        return RouteStep(self._follower.twist, FOLLOWING, self._follower.reason, progress)

    def _end(self, phase: str, reason: str) -> RouteStep:
        self._ended, self._reason = phase, reason
        return RouteStep(STANDSTILL, phase, reason, None)

    def _localize(self, image: Image, stamp_ns: int) -> RouteStep:
        """Look for the robot on the route, every few images."""
        self._lost_ns = stamp_ns if self._lost_ns < 0 else self._lost_ns
        self._searched += 1
        if self._searched % SEARCH_FRAMES == 1:
            place = self._finder.find(image)
            if place is not None:
                return self._begin_at(place.way)
            self._reason = self._finder.reason
        if seconds_between(self._lost_ns, stamp_ns) > self.settings.lost_timeout:
            return self._end(FAILED, self._reason)
        return RouteStep(STANDSTILL, LOCALIZING, self._reason, None)

    def _begin_at(self, way: float) -> RouteStep:
        past = way - self.route.views[self.target].way
        if (-past if self.settings.reverse else past) > PASSED:
            other = _direction(replace(self.settings, reverse=not self.settings.reverse))
            return self._end(
                FAILED, f'the station is {abs(past):.2f} m behind; repeat the route {other}'
            )
        self._follow(way)
        return RouteStep(STANDSTILL, LOCALIZING, f'found after {way:.2f} m', None)

    def _follow(self, way: float) -> None:
        ahead = [k for k, view in enumerate(self.route.views) if view.way > way + PASSED and k]
        last = len(self.route.views) - 1
        view = ahead[0] if ahead else last
        view = max(view, self.target + 1) if self.settings.reverse else min(view, self.target)
        self._follower = Follower(
            self.route,
            self.settings,
            self.base,
            view=view,
            target=self.target,
            way=way,
            latency=self._servo.latency,
        )

    def _begin_docking(self) -> None:
        self._tracker = Tracker(TrackerSettings())
        self._tracker.set_desired(self.route.views[self.target].image)
        self._session = Session(camera=self.route.camera, started=True)

    def _dock(self, image: Image, stamp_ns: int, session: Session) -> RouteStep:
        """Let the servo drive to the photograph of the station."""
        assert self._tracker is not None
        features = self._tracker.track(image)
        seen = observe(features, self.route.camera, stamp_ns)
        session = session.decide(seen, self._servo, goal=features.goal).update_map()
        self._session, state = session, session.state
        if state.phase.ended:
            arrived = state.phase is Phase.ARRIVED
            return self._end(ARRIVED, '') if arrived else self._end(FAILED, state.reason)
        return RouteStep(state.command.twist, state.phase.value, state.reason, None)


def _base(settings: FollowSettings, servo: ServoSettings) -> Base:
    """Return the base of the servo, whatever it can do else, at the speeds of the route."""
    limits = replace(
        servo.drive.limits,
        max_linear=settings.max_speed,
        max_angular=settings.max_turn_rate,
    )
    return base_of(servo.base, limits)


def _direction(settings: FollowSettings) -> str:
    return 'in reverse' if settings.reverse else 'forward'
