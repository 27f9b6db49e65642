"""
Recorded ways with truth: what routes, approaches and ``inspect`` make of them.

The ``frames`` of a way are taught, with their true poses as odometry, and those of ``also`` looked
for. Of an approach the last frame is the goal; a pair is one of two frames.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
import math
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.commands.camera_files import read_camera, read_photograph, scaled_to
from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import DegenerateGeometryError, InputError
from visual_servo_epipolar.core.geometry.motion import Pose, relative_pose
from visual_servo_epipolar.core.routes.places import Place, PlaceFinder
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.matchers.base import RATIO
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.inspection import inspect
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.evaluation.benchmarks.real import (
    angle_errors,
    opencv_motion,
    read_truth,
    set_lines,
    WRONG,
)
from visual_servo_epipolar.evaluation.tables import aligned, number, percentiles
from visual_servo_epipolar.messages.route_folder import write_route
from visual_servo_epipolar.simulation.routes import RIGHT_OFFSET, RIGHT_WAY

SPEED = 0.5  # largest at which a way is taught [m/s]
RATE = 10.0  # frames a second, where truth.json has none
PEER_PX = 0.3  # with which MAGSAC is right most often on such small images
WAYS = (
    'way | m | key views | features | found | refused | wrong | position, median / max [m] '
    '| heading [deg] | error/dev., median / p95 | OpenCV right: heading, bearings '
    '| elsewhere found | kB a metre | ms a frame'
)


@dataclass(frozen=True, eq=False)
class Clip:
    """Frames of a recorded way, their true poses, (3,), by number, in units of ``scale`` [m]."""

    name: str
    kind: str
    folder: Path
    poses: Mapping[int, FloatArray]
    frames: tuple[int, ...]
    also: tuple[int, ...]
    camera: CameraModel
    period_ns: int

    def image(self, frame: int) -> Image:
        """Return a frame."""
        return read_photograph(self.folder / f'{frame:05d}.jpg')

    @cached_property
    def scale(self) -> float:
        """The metres of a unit with which it is nowhere faster than SPEED, to one digit."""
        steps = [
            np.linalg.norm(self.poses[b][:2] - self.poses[a][:2]) / (b - a)
            for a, b in zip(self.frames[:-1], self.frames[1:], strict=True)
        ]
        most = SPEED * self.period_ns / NANOSECONDS / max(steps)
        digit = 10.0 ** math.floor(math.log10(most))
        return float(digit * math.floor(most / digit))

    def metric(self, frame: int) -> FloatArray:
        """Return the true pose of a frame, (3,), in metres."""
        return np.asarray(self.poses[frame] * [self.scale, self.scale, 1.0])

    def bearings(self, current: int, desired: int) -> FloatArray:
        """Return bearings, right positive, of a frame and of the goal, and its heading, (3,)."""
        first, second = self.poses[current], self.poses[desired]
        ahead, behind = relative_pose(first, second), relative_pose(second, first)
        to_goal, from_goal = (-math.atan2(it[1], it[0]) for it in (ahead, behind))
        return np.array([to_goal, from_goal, behind[2]])


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], clips: Iterable[Clip]
) -> dict[str, Any]:
    """Return the document: the ways, and rows of approaches and pairs; ``quick``: one of each."""
    clips = list(clips)
    kinds = {
        'way': [it for it in clips if it.also],
        'bearings': [it for it in clips if not it.also],
    }
    few = slice(1 if quick else None)
    ways, rows = [], []
    for clip in kinds['way'][few]:
        say(clip.name)
        ways.append(_way(clip, [it for it in clips if it.camera != clip.camera]))
    for clip in kinds['bearings'][few]:
        say(clip.name)
        rows += list(_pair(clip) if clip.kind == 'pair' else _approach(clip))
    return {'seed': seed, 'ways': ways, 'bearings': rows}


def _way(clip: Clip, others: list[Clip]) -> dict[str, Any]:
    """Return what is learnt of a way, and where frames of it, and of ``others``, are found."""
    teacher, began = Teacher(clip.camera), time.process_time()
    driven = [clip.metric(frame) for frame in clip.frames]
    row: dict[str, Any] = {'name': clip.name, 'taught': False, 'reason': ''}
    try:
        for frame, pose in zip(clip.frames, driven, strict=True):
            teacher.add(clip.image(frame), frame * clip.period_ns, Pose(*pose.tolist()))
        route = teacher.finish()
    except (ValueError, DegenerateGeometryError) as error:
        return row | {'reason': str(error), 'frames': []}
    each_ms = 1e3 * (time.process_time() - began) / len(clip.frames)
    steps = np.linalg.norm(np.diff(driven, axis=0)[:, :2], axis=1)
    ways = np.concatenate([[0.0], np.cumsum(steps)])
    taken = [clip.frames[int(np.abs(ways - view.way).argmin())] for view in route.views]
    finder = PlaceFinder(route)
    frames = [_frame(clip, frame, route, finder, taken) for frame in clip.also]
    size = clip.camera.width, clip.camera.height
    strange = [cv2.resize(it.image(it.frames[0]), size) for it in others]
    with TemporaryDirectory() as folder:
        write_route(route, Path(folder) / 'route')
        stored = sum(file.stat().st_size for file in (Path(folder) / 'route').iterdir())
    return row | {
        'taught': True,
        'length_m': route.length,
        'key_views': len(route.views),
        'features': float(np.median([len(view.structure) for view in route.views])),
        'teaching_ms': each_ms,
        'bytes_a_metre': stored / route.length,
        'frames': frames,
        'elsewhere': {
            'tried': len(strange),
            'found': sum(finder.find(image) is not None for image in strange),
        },
    }


def _frame(
    clip: Clip, frame: int, route: Route, finder: PlaceFinder, taken: list[int]
) -> dict[str, Any]:
    """Return where a frame is found; ``taken`` are the frames of the key views."""
    image = clip.image(frame)
    place = finder.find(image)
    row = {'frame': frame, 'outcome': 'refused', 'reason': finder.reason}
    if place is not None:
        row |= _judged(place, relative_pose(clip.metric(taken[place.view]), clip.metric(frame)))
    apart = [np.linalg.norm(clip.poses[it][:2] - clip.poses[frame][:2]) for it in taken]
    nearest = taken[int(np.argmin(apart))]
    return row | {'opencv_deg': _opencv(clip, frame, nearest).tolist()}


def _judged(place: Place, true: FloatArray) -> dict[str, Any]:
    away = relative_pose(true, place.pose.pose)
    along, across, heading = away[0], away[1], math.degrees(abs(away[2]))
    right = abs(along) < RIGHT_WAY and abs(across) < RIGHT_OFFSET and heading < WRONG
    return {
        'outcome': 'found' if right else 'wrong',
        'along_m': along,
        'across_m': across,
        'position_error_m': math.hypot(along, across),
        'heading_error_deg': heading,
        'deviation_m': place.deviation,
        'inliers': place.pose.inliers,
    }


def _opencv(clip: Clip, current: int, desired: int) -> FloatArray:
    """Return errors of SIFT and MAGSAC, (3,): of two bearings, and of the heading [deg]."""
    sift = cv2.SIFT_create()
    (first, here), (second, there) = (
        sift.detectAndCompute(clip.image(frame), None) for frame in (current, desired)
    )
    if here is None or there is None or len(there) < 2:
        return np.full(3, math.nan)
    pairs = cv2.BFMatcher().knnMatch(here, there, 2)
    good = [a for a, b in pairs if a.distance < RATIO * b.distance]
    rays = (
        clip.camera.rays(np.array([first[it.queryIdx].pt for it in good]).reshape(-1, 2)),
        clip.camera.rays(np.array([second[it.trainIdx].pt for it in good]).reshape(-1, 2)),
    )
    motion = opencv_motion(rays, PEER_PX / clip.camera.focal, cv2.USAC_MAGSAC)
    return angle_errors(motion, clip.bearings(current, desired))


def _pair(clip: Clip) -> Iterator[dict[str, Any]]:
    desired, current = clip.frames
    images = clip.image(desired), clip.image(current)
    found = inspect(*images, clip.camera, clip.camera, PerceptionSettings())
    bearings = np.array([found.bearing_current, found.bearing_desired, found.rotation])
    yield _bearings_row(
        clip,
        current,
        bearings,
        trusted=found.trusted,
        deviation_deg=math.degrees(found.deviation),
        matches=len(found.current),
        parallax_px=found.parallax_px,
    )


def _approach(clip: Clip) -> Iterator[dict[str, Any]]:
    """Yield what the servo makes of each image, as a replay does that tells no motion."""
    tracker, run = Tracker(TrackerSettings(), clip.camera), Run()
    run = run.with_camera(clip.camera)
    tracker.set_desired(clip.image(clip.frames[-1]))
    for frame in clip.frames[:-1]:
        features = tracker.track(clip.image(frame))
        observation = observe(features, clip.camera, frame * clip.period_ns)
        run = run.decide(observation, ServoSettings(), goal=features.goal).update_map()
        seen = run.state.measurement
        assert seen is not None
        angles = seen.seen_bearings
        found = np.full(3, math.nan)
        if angles is not None:
            found = np.array([angles.current, angles.desired, angles.heading_error])
        yield _bearings_row(
            clip,
            frame,
            found,
            trusted=angles is not None,
            deviation_deg=math.degrees(seen.deviation),
            matches=seen.features,
            parallax_px=seen.parallax_px,
        )


def _bearings_row(
    clip: Clip, frame: int, found: FloatArray, *, trusted: bool, **seen: float
) -> dict[str, Any]:
    """Return the errors [deg] of bearings and heading ``found``, (3,), and what was ``seen``."""
    goal = clip.frames[0 if clip.kind == 'pair' else -1]
    errors = angle_errors(found, clip.bearings(frame, goal))
    return {
        'name': clip.name,
        'group': clip.name,
        'frame': frame,
        'trusted': trusted,
        'error_deg': float(errors[:2].max()),
        'rotation_error_deg': float(errors[2]),
        'peers_deg': {'MAGSAC': float(_opencv(clip, frame, goal)[:2].max())},
        **seen,
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: a line for each way, approach, pair, and band of these."""
    words = (
        f'Recorded ways: found is right within {RIGHT_WAY:g} m along, {RIGHT_OFFSET:g} m across '
        f'and {WRONG:g} deg; bearings are wrong from {WRONG:g} deg on'
    )
    ways = document['ways']
    lines = [words, *aligned(WAYS, map(_way_cells, ways)), '', *set_lines(document['bearings'])]
    return '\n'.join([*lines, *(f'{it["name"]}: {it["reason"]}' for it in ways if it['reason'])])


def _way_cells(way: Mapping[str, Any]) -> list[str]:
    frames = way['frames']
    found = [it for it in frames if it['outcome'] != 'refused']
    outcomes = [it['outcome'] for it in frames]
    if not way['taught']:
        return [way['name'], 'not taught', *['-'] * (WAYS.count('|') - 1)]
    peers = np.array([it['opencv_deg'] for it in frames])
    ratios = [it['position_error_m'] / it['deviation_m'] for it in found]
    elsewhere = way['elsewhere']
    return [
        way['name'],
        number(way['length_m'], 2),
        str(way['key_views']),
        number(way['features'], 0),
        *(str(outcomes.count(what)) for what in ('found', 'refused', 'wrong')),
        percentiles([it['position_error_m'] for it in found], 50, 100, digits=3),
        percentiles([it['heading_error_deg'] for it in found], 50, 100),
        percentiles(ratios, 50, 95),
        ', '.join(str(int((peers[:, it] <= WRONG).all(1).sum())) for it in ([2], [0, 1])),
        f'{elsewhere["found"]} of {elsewhere["tried"]}',
        number(way['bytes_a_metre'], 0, 1e-3),
        number(way['teaching_ms'], 0),
    ]


def read_clips(folder: str) -> list[Clip]:
    """Return the clips of a ``folder`` with a truth.json; InputError if it has none."""
    path, entries = read_truth(folder, dict, 'name recorded ways')
    return [_read(name, entry, path) for name, entry in entries.items()]


def _read(name: str, entry: Any, path: Path) -> Clip:
    try:
        kind, camera_file = str(entry['kind']), path.parent / str(entry['camera'])
        poses = entry['poses_x_ahead_y_left_heading_rad']
        by_frame = {int(frame): np.array(pose, float).reshape(3) for frame, pose in poses.items()}
        frames, also = (tuple(map(int, entry[key])) for key in ('frames', 'also'))
        period_ns = round(NANOSECONDS / float(entry.get('rate', RATE)))
        if len(frames) < 2 or not {*frames, *also} <= by_frame.keys():
            raise ValueError
    except (AttributeError, KeyError, TypeError, ValueError, ZeroDivisionError):
        raise InputError(
            f'{path}: {name} must have kind, camera, two frames or more, also, and the pose of '
            'each frame; see docs/commands/bench.md'
        ) from None
    folder = path.parent / name
    image = folder / f'{frames[0]:05d}.jpg'
    camera = scaled_to(read_camera(str(camera_file)), read_photograph(image), image)
    return Clip(name, kind, folder, by_frame, frames, also, camera, period_ns)
