"""
Teaching: key views and the path between them, from images along a way that is driven once.

A new key view is taken when too little of the last one is still in view. Its features are then
tracked backward through the images since the last key view, and forward until the next: from
these views their depths are estimated, and in them the path is measured.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import DegenerateGeometryError, TrackingError
from visual_servo_epipolar.core.estimate.motion_check import COMMON_SHARE
from visual_servo_epipolar.core.geometry.motion import motion_between, Pose, relative_pose
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.routes.chain import (
    against_odometry,
    believed,
    chained,
    DrivenFrame,
    LearntView,
)
from visual_servo_epipolar.core.routes.path import LEAST_STEP, smooth_path
from visual_servo_epipolar.core.routes.route import (
    FARTHEST,
    in_memory,
    MOST_IMAGES,
    OVERLAP,
    Route,
    RouteView,
    SAME_TURN,
)
from visual_servo_epipolar.core.routes.settings import TeachSettings
from visual_servo_epipolar.core.routes.structure import (
    learn_structure,
    LEAST_VIEWS,
    Localizer,
    SeenView,
)
from visual_servo_epipolar.core.servo.admission import (
    Arrival,
    disorder,
    FrozenImageCheck,
    Repetition,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import (
    MOST_GAP_S,
    NOT_ADVANCING,
    OTHER_CLOCK_S,
    seconds_between,
)
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints
from visual_servo_epipolar.core.tracking.matching import desired_view
from visual_servo_epipolar.core.tracking.photographs import FEW
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.estimator import Attitude

MOST_WAITING = 60  # images that are kept until odometry comes: seconds of them
MOST_BACKWARD = 0.05  # that a base may roll back where it stops [m]
LEAST_TURN = 0.005  # between two images that are kept [rad]
FEATURES = 250  # of a key view
TIGHTEST = 0.2  # radius of a curve [m]
MOST_VIEWS = 12  # from which a structure is learnt


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
        if len(features) >= FEW:
            bare = frame._replace(image=frame.image[:0])
            self.seen[frame.number] = bare, features.ids, features.current
        return len(features)


class Teacher:
    """
    Teacher: takes images along the way, with odometry, and returns the route.

    Where the robot stands for a while, or ``station`` is called, it will end exactly. Where too
    little is seen, that stretch alone is lost: ``notes`` say where and why. ``further`` are the
    parts of the way after a stretch that is too long for the odometry.
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
        self._views: list[LearntView] = []
        self._driven: list[DrivenFrame] = []  # all of them, without images
        self._pending: _Pending | None = None
        self._frames: list[DrivenFrame] = []  # that are kept, since the key view before the last
        self._most = 0
        self._moved_ns = 0
        self._latest: DrivenFrame | None = None
        self._paused = self._is_sparse = False
        self.notes: list[str] = []
        self.further: tuple[Route, ...] = ()

    @property
    def key_views(self) -> int:
        """The number of key views so far."""
        return len(self._views) + (self._pending is not None)

    def add(self, image: Image, stamp_ns: int, odometry: Pose) -> None:
        """
        Take in an image, uint8 of shape (H, W), and where the base was by its odometry.

        Raises ValueError for an image of another size than the camera's.
        """
        if image.shape != (self.camera.height, self.camera.width):
            raise ValueError(
                f'images must be {self.camera.width}x{self.camera.height} as the camera, got '
                f'{image.shape[1]}x{image.shape[0]}; use the calibration of this resolution'
            )
        pose = np.array([odometry.x, odometry.y, odometry.theta])
        first = DrivenFrame(-1, image, stamp_ns, pose, 0.0, 0.0)
        last = self._frames[-1] if self._frames else first
        x, y, turn = relative_pose(last.pose, pose).tolist()
        moved = math.hypot(x, y)
        speed = moved / max(seconds_between(last.stamp_ns, stamp_ns), 1e-3)
        turns = moved < TIGHTEST * abs(turn)
        way = last.way + moved
        latest = DrivenFrame(last.number + 1, image, stamp_ns, pose, way, speed, turns)
        if not self._frames or moved > LEAST_STEP or abs(turn) > LEAST_TURN:
            self._moved_ns, self._paused = stamp_ns, False
            self._keep(latest)
        else:
            self._latest = latest
            stood = seconds_between(self._moved_ns, stamp_ns)
            if self._settings.pause and not self._paused and stood > self._settings.pause:
                self._paused = True
                if last.way > 0.0:
                    self.station()

    def station(self) -> None:
        """Mark where the last image was taken as a station; it is one where it was one already."""
        if self._latest is None:
            raise ValueError('a station must have an image, got none yet; start the camera first')
        pending, last = self._pending, self._frames[-1]
        is_here = pending is not None and pending.frame.number == last.number
        stands = is_here and (last.way == 0.0 or pending is not None and pending.is_station)
        if not stands and self._latest is not last:
            self._keep(self._latest)
        if self._pending is None or self._pending.frame.number != self._frames[-1].number:
            self._begin_key_view(self._frames[-1])
        if self._pending is not None:
            self._pending.is_station = True

    def finish(self) -> Route:
        """
        Return the route, up to the first stretch that is too long for the odometry, if any.

        Its first and last key views are stations. Raises DegenerateGeometryError where the way
        shows too little, or contradicts the odometry.
        """
        if self._frames and self._frames[-1].way < LEAST_STEP:
            raise DegenerateGeometryError(
                f'the robot must drive while a route is taught, got {self._frames[-1].way:.2f} m '
                'by its odometry: it stood; drive the way, or look which robot the odometry is of'
            )
        self.station()
        self._end_key_view()
        parts: list[list[LearntView]] = []
        for learnt in believed(self._views):
            end = parts[-1][-1].view.path.way[-1] if parts else -math.inf
            if learnt.view.path.way[0] - end > 0.5 * FARTHEST:
                parts.append([])
            parts[-1].append(learnt)
        parts = [part for part in parts if len(part) > 1]
        if not parts and self.notes:
            raise DegenerateGeometryError(self.notes[0])
        routes = [self._route(part) for part in parts or [self._views]]
        self.further = tuple(routes[1:])
        for before, after in zip(parts[:-1], parts[1:], strict=True):
            end, begin = before[-1].view.path.way[-1], after[0].view.path.way[0]
            self.notes.append(
                f'a part of the way ends after {end:.2f} m: up to {begin:.2f} m nothing is known'
            )
        return routes[0]

    def _route(self, part: Sequence[LearntView]) -> Route:
        """Return the route of key views; it begins and ends at a station."""
        views = list(chained(part, self._driven))
        for end in (0, -1) if views else ():
            views[end] = replace(views[end], is_station=True)
        self.notes += [
            f'before {view.way:.2f} m the odometry bridges {view.bridge.way:.2f} m and '
            f'{math.degrees(view.bridge.turn):+.0f} deg, to {1e3 * view.bridge.deviation:.0f} mm'
            for view in views
            if view.bridge is not None
        ]
        self.notes += against_odometry(part)
        return Route(self.camera, tuple(views))

    def _keep(self, frame: DrivenFrame) -> None:
        """Keep a frame, and begin a key view there if it is time."""
        self._latest = frame = frame._replace(image=frame.image.copy())
        self._frames = [*self._frames[1 - MOST_IMAGES :], frame]
        self._driven.append(frame._replace(image=frame.image[:0]))
        if self._pending is None:
            if not frame.turns:
                self._begin_key_view(frame)
            return
        count = self._pending.track(frame)
        self._most = max(self._most, count)
        since = self._pending.frame
        turn = abs(float(relative_pose(since.pose, frame.pose)[2]))
        too_far = frame.way - since.way > 0.5 * FARTHEST or turn > SAME_TURN
        is_due = too_far or count < COMMON_SHARE * self._most
        # It waits for the images from which this one is learnt.
        if not is_due or len(self._pending.seen) <= 2 * LEAST_VIEWS and count >= FEW:
            return
        if frame.turns and frame.way - since.way < SAME_TURN * TIGHTEST:
            self._end_key_view()  # what a turn on the spot shows has no depth
        else:
            self._begin_key_view(frame)

    def _begin_key_view(self, frame: DrivenFrame) -> None:
        """End the last key view, and begin one at a frame: first back through those before."""
        self._end_key_view()
        settings = TrackerSettings(max_features=FEATURES, candidates=2 * FEATURES)
        tracker = Tracker(settings, self.camera, as_many=False)
        try:
            view = desired_view(frame.image, canvas=tracker.canvas)
        except TrackingError:
            self._note(
                frame,
                'an image shows too little to be tracked; drive slower, or where '
                'there is more to see',
            )
            return
        tracker.set_view(view)
        pixels = tracker.canvas.pixels_of_image(view.keypoints.pixels)
        pending = _Pending(frame, tracker, replace(view.keypoints, pixels=pixels))
        least = -math.inf
        if self._views:
            least = self._views[-1].view.way - OVERLAP
        for before in reversed(self._frames):
            if before.way < least or pending.track(before) < FEW:
                break
        tracker.redetect()
        self._most = pending.track(frame)
        self._pending = pending
        self._frames = [each for each in self._frames if each.way >= least]

    def _end_key_view(self) -> None:
        """Learn from the last key view; one that cannot be learnt is left out."""
        pending, self._pending = self._pending, None
        if pending is None:
            return
        try:
            view, located = _learnt(pending, self.camera, self._mount)
        except (DegenerateGeometryError, ValueError) as error:
            self._note(pending.frame, str(error))
            return
        self._is_sparse = False
        self._views.append(LearntView(view, located, pending.frame))

    def _note(self, frame: DrivenFrame, reason: str) -> None:
        """Note where a stretch begins that cannot be learnt, and why."""
        if not self._is_sparse:
            seconds = seconds_between(self._driven[0].stamp_ns, frame.stamp_ns)
            self.notes.append(f'after {frame.way:.2f} m, {seconds:.1f} s: {reason}')
        self._is_sparse = True


def _learnt(
    pending: _Pending, camera: CameraModel, mount: Attitude
) -> tuple[RouteView, dict[int, FloatArray]]:
    """Return the key view, and the poses of frames in its axes."""
    photograph = pending.keypoints.pixels
    views = list(_views(pending, camera))
    elsewhere = sum(float(np.hypot(*view.pose[:2])) > LEAST_STEP for view in views)
    if elsewhere < LEAST_VIEWS:
        raise DegenerateGeometryError(
            f'a key view shares features with {elsewhere} images from elsewhere, {LEAST_VIEWS} '
            'are needed; drive slower, or where there is more to see'
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
            if not frame.turns:
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


class DrivenImages:
    """
    Images along a way in order of time, placed on the ``path`` of the base.

    ``trouble`` says why no route can be learnt from them, and where. Images that are the very same
    for ``still_timeout`` [s] of driving are of a camera that hangs.
    """

    def __init__(self, path: Path, still_timeout: float = ServoSettings.stale_timeout) -> None:
        self.trouble, self._path, self._still_timeout = '', path, still_timeout
        self._repetition, self._views = Repetition(), FrozenImageCheck()
        self._waiting: deque[tuple[Image, Arrival]] = deque()
        self._stamps: list[int] = []  # of all images in order, and of those on the path
        self._placed: list[int] = []
        self._early = self._unordered = self._repeated = 0
        self._epoch, self._moved_ns, self._anchor = path.epoch, 0, Pose(0.0, 0.0, 0.0)
        self._way = self._furthest = 0.0

    @property
    def unplaced(self) -> int:
        """The number of images that the path does not reach yet."""
        return len(self._stamps) - len(self._placed) - self._early

    @property
    def missing(self) -> str:
        """Return in words why no image has a place yet, or ''."""
        if self._placed or not self._stamps:
            return ''
        return self._path.missing(self._stamps[-1])

    @property
    def notes(self) -> list[str]:
        """What is left out of the way."""
        late = seconds_between(self._stamps[0], self._placed[0]) if self._placed else 0.0
        early = self._early if late > MOST_GAP_S else 0
        left_out = {
            f'before {self._path.topic} begins, {late:.1f} s after the first': early,
            'not newer than the one before': self._unordered,
            'the same as the one before while the robot drove': self._repeated,
        }
        return [f'{count} images are left out, {why}' for why, count in left_out.items() if count]

    def see(self, image: Image, stamp_ns: int) -> None:
        """Take in an image, uint8 of shape (H, W)."""
        newest_ns = self._stamps[-1] if self._stamps else None
        disordered = disorder(newest_ns, stamp_ns, 'another recording')
        if disordered:
            self._unordered += 1
            if disordered != NOT_ADVANCING:
                self.trouble = self.trouble or disordered
            return
        if not self._stamps:
            self._epoch = self._path.epoch
        self._stamps.append(stamp_ns)
        repeats = self._repetition.see(image)
        oldest_ns = self._waiting[0][1].stamp_ns if self._waiting else stamp_ns
        full = len(self._waiting) >= MOST_WAITING
        if not full or seconds_between(oldest_ns, stamp_ns) <= MOST_GAP_S:
            back = self._repetition.back
            self._waiting.append((image, Arrival(stamp_ns, stamp_ns, repeats=repeats, back=back)))

    def placed(self) -> Iterator[tuple[Image, int, Pose]]:
        """Yield images that the path reaches by now, their stamps, and where the base was."""
        while self._waiting and not self.trouble:
            image, arrival = self._waiting[0]
            stamp_ns = arrival.stamp_ns
            place, lag = self._path.at(stamp_ns), self._path.lag(stamp_ns)
            never = lag < 0.0 if self._placed else OTHER_CLOCK_S <= abs(lag) < math.inf
            if self._path.epoch != self._epoch:
                self._refuse(self._path.rupture)
            elif never:
                self._refuse(self._path.missing(stamp_ns))
            elif place is None and lag > 0.0:
                return
            else:
                self._waiting.popleft()
                self._early += place is None
                pose = None if place is None else Pose(*place.pose.tolist())
                if pose is not None and self._admits(arrival, pose):
                    yield image, stamp_ns, pose

    def finish(self) -> None:
        """Look for trouble with the whole: where the path ends too early, and with the order."""
        if self.trouble or not self._stamps:
            return
        newest_ns, placed, unplaced = self._stamps[-1], len(self._placed), self.unplaced
        if self.missing:
            self._refuse(self.missing)
        elif unplaced and seconds_between(self._placed[-1], newest_ns) > MOST_GAP_S:
            self._refuse(
                f'{self._path.missing(newest_ns)}; the last {unplaced} of {len(self._stamps)} '
                'images have no place'
            )
        elif self._unordered > placed:
            self._refuse(
                f'{self._unordered} images are not newer than the one before, {placed} are; let '
                'their driver stamp each'
            )
        elif self._furthest < LEAST_STEP:
            self._refuse(f'the robot did not drive, by {self._path.topic}; look at its wheels')

    def _admits(self, arrival: Arrival, pose: Pose) -> bool:
        """Return whether an image at a ``pose`` may be learnt from."""
        way, turn = motion_between(self._anchor, pose)
        if not self._placed or abs(way) > LEAST_STEP or abs(turn) > LEAST_TURN:
            self._anchor, self._moved_ns = pose, arrival.stamp_ns
            self._way += way if self._placed else 0.0
            self._furthest = max(self._furthest, self._way)
        self._placed.append(arrival.stamp_ns)
        drives = seconds_between(self._moved_ns, arrival.stamp_ns) < self._still_timeout
        self._views = self._views.after(arrival, drives=drives)
        still, backward = self._views.trouble(self._still_timeout), self._furthest - self._way
        if still:
            self._refuse(still)
        elif backward > MOST_BACKWARD:
            self._refuse(
                f'the robot drove backward by {backward:.2f} m, at most {MOST_BACKWARD:g} m can '
                'be; teach the way forward, and repeat it with reverse'
            )
        repeated = drives and arrival.repeats > 0
        self._repeated += repeated
        return not (self.trouble or repeated)

    def _refuse(self, reason: str) -> None:
        """Take note of trouble, and where it is."""
        where = ''
        if self._placed:
            since = seconds_between(self._stamps[0], self._placed[-1])
            where = f'after {self._furthest:.2f} m, {since:.1f} s from the first image: '
        self.trouble = f'{where}{reason}; record the way anew'
