"""Station: the servo drives to its photographs; commands show when their scene was moved."""

from contextlib import suppress
from dataclasses import replace
import math

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.routes.route import RouteView
from visual_servo_epipolar.core.servo.run import Interruption, Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.observation import observe

APART, APART_SHARE = 0.05, 0.1  # of a station [m], and share of what was driven


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
        if self._run is None or apart <= APART + APART_SHARE * self._driven:
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
