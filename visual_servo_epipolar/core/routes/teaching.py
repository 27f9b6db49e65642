"""
Teaching: key views and the path between them, from images along a way that is driven once.

A new key view is taken when too little of the last one is still in view. Its features are then
tracked backward through the images since the last key view, and forward until the next: from
these views their depths are learnt, and in them the path is measured.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.planar_poses import relative_pose
from visual_servo_epipolar.core.routes.chain import chained
from visual_servo_epipolar.core.routes.path import smooth_path
from visual_servo_epipolar.core.routes.route import in_memory, Route, RouteView
from visual_servo_epipolar.core.routes.settings import TeachSettings
from visual_servo_epipolar.core.routes.structure import learn_structure, Localizer, SeenView
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints
from visual_servo_epipolar.core.tracking.matching import desired_view
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker

LEAST_STEP, LEAST_TURN = 0.01, 0.005  # between two images that are kept [m, rad]
TIGHTEST = 0.2  # radius of a curve [m]
FEWEST = 20  # features of a view that is learnt from
ENOUGH = 4  # images that show a key view, for which the next one waits
MOST_VIEWS = 12  # from which a structure is learnt


class DrivenFrame(NamedTuple):
    """Image on the way: its number, where the base was by odometry, (3,), and how far it drove."""

    number: int
    image: Image
    stamp_ns: int
    pose: FloatArray
    way: float
    speed: float


@dataclass(eq=False)
class _Pending:
    """A key view being learnt: its frame, its tracker, and what frames show of its features."""

    frame: DrivenFrame
    tracker: Tracker
    keypoints: Keypoints
    is_station: bool = False
    seen: dict[int, tuple[DrivenFrame, IntArray, FloatArray]] = field(default_factory=dict)

    def track(self, frame: DrivenFrame) -> int:
        """Look for its features in a frame; return how many there are."""
        features = self.tracker.track(frame.image)
        if len(features) >= FEWEST:
            bare = frame._replace(image=frame.image[:0])
            self.seen[frame.number] = bare, features.ids, features.current
        return len(features)


class Teacher:
    """
    Teacher: takes images along the way, with odometry, and returns the route.

    Where the robot stands for a while, or ``station`` is called, it will end exactly.
    """

    def __init__(
        self,
        camera: CameraModel,
        settings: TeachSettings | None = None,
        mount: Attitude | None = None,
    ) -> None:
        self.camera = camera
        self._settings = TeachSettings() if settings is None else settings
        self._mount = Attitude() if mount is None else mount
        self._views: list[RouteView] = []
        self._located: list[dict[int, FloatArray]] = []  # by key view: poses of frames
        self._pending: _Pending | None = None
        self._frames: list[DrivenFrame] = []  # that are kept, since the key view before the last
        self._most = 0
        self._moved_ns = 0
        self._latest: DrivenFrame | None = None
        self._paused = False

    @property
    def key_views(self) -> int:
        """The number of key views so far."""
        return len(self._views) + (self._pending is not None)

    def add(self, image: Image, stamp_ns: int, odometry: Pose) -> None:
        """
        Take in an image, uint8 of shape (H, W), and where the base was by its odometry.

        Raises ValueError for an image of another size than the camera's, and
        DegenerateGeometryError where the way shows too little to be learnt.
        """
        if image.shape != (self.camera.height, self.camera.width):
            raise ValueError(
                f'images must be {self.camera.width}x{self.camera.height} as the camera, got '
                f'{image.shape[1]}x{image.shape[0]}; use the calibration of this resolution'
            )
        pose = np.array([odometry.x, odometry.y, odometry.theta])
        latest = DrivenFrame(0, image, stamp_ns, pose, 0.0, 0.0)
        if self._frames:
            last = self._frames[-1]
            moved = math.hypot(*(pose - last.pose)[:2])
            speed = moved / max(seconds_between(last.stamp_ns, stamp_ns), 1e-3)
            latest = DrivenFrame(last.number + 1, image, stamp_ns, pose, last.way + moved, speed)
        if not self._frames or _has_moved(self._frames[-1].pose, pose):
            self._moved_ns, self._paused = stamp_ns, False
            self._keep(latest)
        else:
            self._latest = latest
            stood = seconds_between(self._moved_ns, stamp_ns)
            if self._settings.pause and not self._paused and stood > self._settings.pause:
                self._paused = True
                if self._frames[-1].way > 0.0:
                    self.station()

    def station(self) -> None:
        """Mark where the last image was taken as a station; it is one where it was one already."""
        if self._latest is None:
            raise ValueError('a station must have an image, got none yet; start the camera first')
        assert self._pending is not None
        is_here = self._pending.frame.number == self._frames[-1].number
        stands = is_here and (self._pending.is_station or self._frames[-1].way == 0.0)
        if not stands and self._latest is not self._frames[-1]:
            self._keep(self._latest)
        if self._pending.frame.number != self._frames[-1].number:
            self._begin_key_view(self._frames[-1])
        self._pending.is_station = True

    def finish(self) -> Route:
        """Return the route; its first and last key views are stations."""
        if self._frames and self._frames[-1].way < LEAST_STEP:
            raise DegenerateGeometryError(
                f'the robot must drive while a route is taught, got {self._frames[-1].way:.2f} m '
                'by its odometry: it stood; drive the way, or look which robot the odometry is of'
            )
        self.station()
        self._end_key_view()
        if self._views:
            self._views[0] = replace(self._views[0], is_station=True)
        return Route(self.camera, chained(self._views, self._located))

    def _keep(self, frame: DrivenFrame) -> None:
        """Keep a frame, and begin a key view there if it is time."""
        self._latest = frame = frame._replace(image=frame.image.copy())
        self._frames.append(frame)
        if self._pending is None:
            self._begin_key_view(frame)
            return
        count = self._pending.track(frame)
        self._most = max(self._most, count)
        settings, since = self._settings, self._pending.frame
        turn = abs(float(relative_pose(since.pose, frame.pose)[2]))
        if turn > settings.max_turn and frame.way - since.way < settings.max_turn * TIGHTEST:
            raise DegenerateGeometryError(
                f'the robot turns on the spot after {frame.way:.2f} m, which a route cannot hold; '
                f'drive curves of {TIGHTEST:g} m and more'
            )
        too_far = frame.way - since.way > settings.max_spacing or turn > settings.max_turn
        is_due = too_far or count < settings.min_shared * self._most
        if is_due and (len(self._pending.seen) > ENOUGH or count < FEWEST):
            self._begin_key_view(frame)

    def _begin_key_view(self, frame: DrivenFrame) -> None:
        """End the last key view, and begin one at a frame: first back through those before."""
        self._end_key_view()
        count = self._settings.features
        tracker = Tracker(TrackerSettings(max_features=count, candidates=2 * count), self.camera)
        view = desired_view(frame.image, canvas=tracker.canvas)
        tracker.set_view(view)
        pixels = tracker.canvas.pixels_of_image(view.keypoints.pixels)
        pending = _Pending(frame, tracker, replace(view.keypoints, pixels=pixels))
        least = -math.inf
        if self._views:
            least = self._views[-1].way - self._settings.overlap
        for before in reversed(self._frames):
            if before.way < least or pending.track(before) < FEWEST:
                break
        tracker.redetect()
        self._most = pending.track(frame)
        self._pending = pending
        self._frames = [each for each in self._frames if each.way >= least]

    def _end_key_view(self) -> None:
        pending, self._pending = self._pending, None
        if pending is None:
            return
        view, located = _learnt(pending, self.camera, self._mount)
        self._views.append(view)
        self._located.append(located)


def _has_moved(before: FloatArray, pose: FloatArray) -> bool:
    x, y, turn = relative_pose(before, pose).tolist()
    return math.hypot(x, y) > LEAST_STEP or abs(turn) > LEAST_TURN


def _learnt(
    pending: _Pending, camera: CameraModel, mount: Attitude
) -> tuple[RouteView, dict[int, FloatArray]]:
    """Return the key view, and the poses of frames in its axes."""
    photograph = pending.keypoints.pixels
    views = list(_views(pending, camera))
    if len(views) < 2:
        raise DegenerateGeometryError(
            f'a key view after {pending.frame.way:.2f} m shares features with {len(views)} '
            'images, two are needed; drive slower, or where there is more to see'
        )
    rows, structure = learn_structure(photograph, views, camera, mount)
    localizer, number = Localizer(structure, camera), np.full(len(photograph), -1)
    number[rows] = np.arange(len(rows))
    located: dict[int, FloatArray] = {}
    frames: list[DrivenFrame] = []
    for frame, ids, pixels in sorted(pending.seen.values(), key=lambda it: it[0].number):
        known = number[ids] >= 0
        near = relative_pose(pending.frame.pose, frame.pose)
        found = localizer.locate(number[ids][known], pixels[known], near)
        if found is not None:
            located[frame.number] = found.pose
            frames.append(frame)
    path = smooth_path(
        np.array([frame.way for frame in frames]),
        np.array([located[frame.number] for frame in frames]).reshape(-1, 3),
        np.array([frame.speed for frame in frames]),
    )
    view = RouteView(
        in_memory(pending.frame.image),
        pending.keypoints.take(rows),
        structure,
        path,
        pending.frame.way,
        np.zeros(3),
        pending.is_station,
    )
    return view, located


def _views(pending: _Pending, camera: CameraModel) -> Iterator[SeenView]:
    """Yield views to learn from: some of those around the photograph, evenly along the way."""
    others = [it for number, it in sorted(pending.seen.items()) if number != pending.frame.number]
    count = min(MOST_VIEWS, len(others))
    for k in np.unique(np.linspace(0, len(others) - 1, count).round().astype(int)).tolist():
        frame, ids, pixels = others[k]
        yield SeenView(ids, camera.rays(pixels), relative_pose(pending.frame.pose, frame.pose))
