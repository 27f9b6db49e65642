"""
Tracking benchmark: errors of features along rendered approaches, calm and disturbed, and time.

Errors are those of trackable features. A gross error is a feature reported as good, off the edges
of depth, more than GROSS from its place, whether or not that place is hidden: nothing flagged it.
Those on edges of depth are counted apart, for they have no single true place.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.flow import CRITERIA, Points
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.benchmarks.tracking_world import (
    approach,
    FrameErrors,
    RenderedWorld,
    STANDING,
    start_of,
    TrueFeatures,
)
from visual_servo_epipolar.evaluation.tables import aligned, number
from visual_servo_epipolar.simulation.disturbances import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

SCENES = (101, 102, 103, 104, 105)  # none of them served to tune the tracker
DISTURBED_SCENES = 2
CONFIGURATIONS: Mapping[str, Mapping[str, Any]] = {
    'anchored': {},
    'every 5 frames': {'anchor_period': 5},
    'frame to frame': {'anchor_period': 0},
}
SECONDS_3 = 33  # frames
DISTURBANCES: Mapping[str, Mapping[str, Any]] = {
    'light -30 %': {'light_step': -0.3},
    'light +30 %': {'light_step': 0.3},
    'slow light': {'light_wave': 0.3},
    'shadow': {'shadow': 0.4, 'disturbed_for': 60},
    'occluder at once': {'occlusion': 0.3},
    'occluder slides in': {'occlusion': 0.3, 'occlusion_from': 'side'},
    'person': {'person': 0.8, 'disturbed_for': 45},
    'motion blur': {'motion_blur': 8.0, 'blur_angle': 0.2},
    'noise': {'extra_noise': 5.0},
}
TIMED = 60  # images, the last ones of an approach
GROSS = 3.0  # a feature farther than this from its place is a wrong one [px]
FLOOR_FIGURES = (
    *('tracker_ms', 'floor_ms'),
    *('ratio_low', 'ratio', 'ratio_high', 'ratio_worst', 'worst_ms'),
)
ENOUGH = 26  # features of the paper's experiments


@dataclass(slots=True)
class TrackerRun:
    """
    One tracker on an approach: its disturbances, errors frame by frame, time of each frame [s].

    ``given_up`` counts right tracks that ended while their point could not, or could, be tracked.
    """

    name: str
    tracker: Tracker
    disturbances: Disturbances | None = None
    errors: list[FrameErrors] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    given_up: tuple[int, int] = 0, 0

    def track(self, image: Image, truth: TrueFeatures, pose: Pose, frame: int) -> None:
        """Track one image, shape (H, W), and note the errors."""
        began = perf_counter()
        features = self.tracker.track(image)
        self.seconds.append(perf_counter() - began)
        if self.errors:
            gone = ended_tracks(self.errors[-1], features)
            trackable = truth.errors(gone, pose, self.disturbances, frame).trackable
            lost, in_view = self.given_up
            self.given_up = lost + int((~trackable).sum()), in_view + int(trackable.sum())
        self.errors.append(truth.errors(features, pose, self.disturbances, frame))


@dataclass(frozen=True, slots=True)
class TrackingPlan:
    """How much is done: scenes, how many of them disturbed and how, frames, camera."""

    scenes: Sequence[int] = SCENES
    disturbed: int = DISTURBED_SCENES
    frames: int = 200
    camera: CameraSettings = CameraSettings(noise=2.0, gain_drift=0.05)
    disturbances: Sequence[str] = tuple(DISTURBANCES)


QUICK = TrackingPlan(
    scenes=SCENES[:1],
    disturbed=1,
    frames=40,
    camera=CameraSettings(
        width=640,
        height=480,
        focal_length=384.6,
        principal_u=319.5,
        principal_v=239.5,
        noise=2.0,
        gain_drift=0.05,
    ),
    disturbances=('light -30 %', 'occluder at once'),
)


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document of the benchmark; ``say`` takes the progress."""
    return measure(QUICK if quick else TrackingPlan(), seed, say)


def measure(plan: TrackingPlan, seed: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Carry out ``plan``."""
    scenes: list[dict[str, Any]] = []
    disturbed: list[dict[str, Any]] = []
    kept: list[Image] = []
    for index, scene in enumerate(plan.scenes):
        names = plan.disturbances if index < plan.disturbed else ()
        keep = TIMED if index == 0 else 0
        calm, rough, images = _scene(plan, scene, seed, names, keep, say)
        scenes.append(calm)
        disturbed += rough
        kept = kept or images
    say('time per frame')
    return {
        'seed': seed,
        'frames': plan.frames,
        'size': [plan.camera.width, plan.camera.height],
        'scenes': scenes,
        'disturbed': disturbed,
        'over_floor': [over_floor(images[0], images[1:]) for images in _sizes(plan, seed, kept)],
    }


def _sizes(plan: TrackingPlan, seed: int, kept: list[Image]) -> list[list[Image]]:
    """Return photograph and images at the plan's size, ``kept``, and at the usual one."""
    camera = QUICK.camera
    if plan.camera.width * plan.camera.height <= camera.width * camera.height:
        return [kept]
    world = RenderedWorld(_with_seeds(camera, plan.scenes[0], seed))
    poses = approach(start_of(seed + plan.scenes[0], plan.frames), plan.frames)
    frames = range(plan.frames - len(kept) + 1, plan.frames)
    images = [world.capture(world.renderer.render(poses[k]), k, None) for k in frames]
    return [kept, [world.photograph(), *images]]


def _scene(
    plan: TrackingPlan,
    scene: int,
    seed: int,
    names: Sequence[str],
    keep: int,
    say: Callable[[str], None],
) -> tuple[dict[str, Any], list[dict[str, Any]], list[Image]]:
    """Return the figures of all configurations, those of the disturbances, and ``keep`` images."""
    start = start_of(seed + scene, plan.frames)
    world = RenderedWorld(_with_seeds(plan.camera, scene, seed))
    desired = world.photograph()
    runs = [TrackerRun(name, _tracker(desired, **how)) for name, how in CONFIGURATIONS.items()]
    runs += [
        TrackerRun(name, _tracker(desired), _disturbances(name, plan, world, seed))
        for name in names
    ]
    images: list[Image] = [desired]
    for frame, pose in enumerate(approach(start, plan.frames)):
        say(f'scene {scene}: frame {frame + 1} of {plan.frames}, {len(runs)} trackers')
        perfect = world.renderer.render(pose)
        calm = world.capture(perfect, frame, None)
        if keep and frame >= plan.frames - keep:
            images.append(calm)
        for tracked in runs:
            rough = tracked.disturbances
            image = calm if rough is None else world.capture(perfect, frame, rough)
            tracked.track(image, world.truth, pose, frame)
    calm_runs, rough_runs = runs[: len(CONFIGURATIONS)], runs[len(CONFIGURATIONS) :]
    configurations = {tracked.name: _figures(world, tracked) for tracked in calm_runs}
    return (
        {'scene': scene, 'start': list(start), 'configurations': configurations},
        [{'scene': scene, **_rough_figures(world, tracked)} for tracked in rough_runs],
        images,
    )


def _with_seeds(camera: CameraSettings, scene: int, seed: int) -> CameraSettings:
    return replace(camera, scene_seed=scene, seed=seed + scene)


def _tracker(desired: Image, **changes: Any) -> Tracker:
    tracker = Tracker(TrackerSettings(**changes))
    tracker.set_desired(desired)
    return tracker


def _disturbances(name: str, plan: TrackingPlan, world: RenderedWorld, seed: int) -> Disturbances:
    """Return the named disturbance, beginning at three tenths of the approach."""
    first = (3 * plan.frames) // 10
    timing = {'disturbed_from': first, 'disturbed_for': min(SECONDS_3, plan.frames // 4)}
    settings = DisturbanceSettings(**{**timing, **DISTURBANCES[name]})
    return Disturbances(world.size, settings, seed)


def _figures(world: RenderedWorld, tracked: TrackerRun) -> dict[str, Any]:
    milliseconds = 1e3 * np.array(tracked.seconds[1:])
    return {
        **scores(world.truth, tracked.errors),
        'given_up': list(tracked.given_up),
        'frame_ms': float(np.median(milliseconds)),
        'slowest_ms': float(milliseconds.max()),
    }


def _rough_figures(world: RenderedWorld, tracked: TrackerRun) -> dict[str, Any]:
    assert tracked.disturbances is not None
    settings = tracked.disturbances.settings
    over = settings.disturbed_from + settings.disturbed_for
    during = tracked.errors[settings.disturbed_from : over]
    errors = np.concatenate([*(each.distances[each.trackable] for each in during), np.empty(0)])
    return {
        'disturbance': tracked.name,
        'during_px': float(np.median(errors)) if len(errors) else None,
        'recovered_after': recovery_time(tracked.errors, over),
        **_figures(world, tracked),
    }


def scores(truth: TrueFeatures, frames: Sequence[FrameErrors]) -> dict[str, Any]:
    """Return the figures of one run."""
    counts = [len(each.features) for each in frames]
    gross = [~each.on_edge & (each.distances > GROSS) for each in frames]
    tracks = [each.features.ids[rows] for each, rows in zip(frames, gross, strict=True)]
    edges, wrong = sum(int(each.on_edge.sum()) for each in frames), sum(map(len, tracks))
    ages = [each.features.ages for each in frames[1:]]
    route, goal = (
        np.concatenate([*(each.distances[each.trackable] for each in part), np.empty(0)])
        for part in (frames[:-STANDING], frames[-STANDING:])
    )
    return {
        'route_px': _percentile(route, 50.0),
        'route_p95_px': _percentile(route, 95.0),
        'goal_px': _percentile(goal, 50.0),
        'goal_p95_px': _percentile(goal, 95.0),
        'gross': wrong,
        'gross_share': wrong / max(sum(counts) - edges, 1),
        'gross_tracks': len(np.unique(np.concatenate(tracks))),
        'edge_share': edges / max(sum(counts), 1),
        'fewest': min(counts),
        'fewest_places': min(map(places, frames)),
        'few_frames': sum(count < ENOUGH for count in counts),
        'redetections': sum(bool((age == 0).any()) for age in ages),
        **_pose_errors(truth, frames[-STANDING:]),
    }


def places(frame_errors: FrameErrors) -> int:
    """Count the features at different places: two at one pixel tell no more than one."""
    return len(np.unique(np.rint(frame_errors.features.desired), axis=0))


def ended_tracks(before: FrameErrors, features: Features) -> Features:
    """Return the tracks of the frame ``before`` that were right and are not in ``features``."""
    tracks = before.features
    rows = ~np.isin(tracks.ids, features.ids) & (before.distances <= GROSS)
    return Features(
        tracks.ids[rows],
        tracks.current[rows],
        tracks.desired[rows],
        tracks.ages[rows],
        tracks.errors[rows],
    )


def recovery_time(frames: Sequence[FrameErrors], first: int) -> int | None:
    """Return how many frames after ``first`` there are enough features for good; None: never."""
    few = [
        frame
        for frame, frame_errors in enumerate(frames)
        if frame >= first and len(frame_errors.features) < ENOUGH
    ]
    if not few:
        return 0
    return None if few[-1] == len(frames) - 1 else few[-1] + 1 - first


def _pose_errors(truth: TrueFeatures, goal: Sequence[FrameErrors]) -> dict[str, float | None]:
    errors = [error for error in map(truth.pose_error, goal) if error is not None]
    names = ('pose_x_mm', 'pose_y_mm', 'pose_heading_deg')
    if not errors:
        return dict.fromkeys(names)
    typical = np.abs(np.array(errors)).mean(axis=0) * [1e3, 1e3, math.degrees(1.0)]
    return dict(zip(names, typical.tolist(), strict=True))


def _percentile(values: FloatArray, share: float) -> float | None:
    return float(np.percentile(values, share)) if len(values) else None


def over_floor(desired: Image, images: Sequence[Image]) -> dict[str, Any]:
    """
    Return the anchored tracker's time of a frame over that of one pyramid and one bare flow.

    Processor time on one thread, the two by turns on the same images, shape (H, W), and features;
    medians [ms], and of the ratio the quartiles and the worst frame. A frame in which the whole
    image is matched is another matter.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rows = _by_turns(desired, images)
    finally:
        cv2.setNumThreads(threads)
    height, width = desired.shape
    document: dict[str, Any] = {'size': [width, height], 'frames': len(rows)}
    if not len(rows):
        return document | dict.fromkeys(FLOOR_FIGURES)
    tracker, floor = np.median(rows, axis=0)
    ratio = np.percentile(rows[:, 0] / rows[:, 1], (25, 50, 75, 100))
    figures = 1e3 * tracker, 1e3 * floor, *ratio, 1e3 * rows[:, 0].max()
    return document | dict(zip(FLOOR_FIGURES, map(float, figures), strict=True))


def _by_turns(desired: Image, images: Sequence[Image]) -> FloatArray:
    """Return seconds of the tracker and of the floor, (N, 2), of images that it follows."""
    tracker, rows = _tracker(desired), []
    features = tracker.track(images[0])
    for k in range(1, len(images)):
        points, matchings = features.current.astype(np.float32), tracker.matchings
        alone = _floor(images[k - 1], images[k], points) if k % 2 else 0.0  # neither always first
        start = process_time()  # finds the image in the cache
        features = tracker.track(images[k])
        seconds = process_time() - start
        if not k % 2:
            alone = _floor(images[k - 1], images[k], points)
        if len(points) and tracker.matchings == matchings:
            rows.append((seconds, alone))
    return np.array(rows).reshape(-1, 2)


def _floor(last: Image, image: Image, points: Points) -> float:
    """Return the time of one pyramid and one bare flow of ``points``, (N, 2) [s]."""
    settings = TrackerSettings()
    window, start = (settings.window, settings.window), process_time()
    if len(points):
        cv2.buildOpticalFlowPyramid(image, window, settings.levels, withDerivatives=False)
        cv2.calcOpticalFlowPyrLK(
            last, image, points, None, winSize=window, maxLevel=settings.levels, criteria=CRITERIA
        )
    return process_time() - start


CALM = (
    'scene | configuration | en route med p95 | at goal med p95 | gross (tracks) share | fewest '
    '| edges | pose x y mm, deg | redet. | ms med max'
)
ROUGH = (
    'scene | disturbance | med, during | at goal | gross (tracks) | fewest '
    f'| frames < {ENOUGH} | regained after | given up | redet.'
)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: accuracy, robustness, time."""
    width, height = document['size']
    calm = (
        _calm_row(scene['scene'], name, it)
        for scene in document['scenes']
        for name, it in scene['configurations'].items()
    )
    return '\n'.join(
        [
            f'Tracking, {document["frames"]} rendered frames of {width}x{height} a scene, '
            'errors in px against ground truth',
            '',
            *aligned(CALM, calm, left=2),
            '',
            *aligned(ROUGH, map(_rough_row, document['disturbed']), left=2),
            '',
            *_floor_rows(document['over_floor']),
        ]
    )


def _px(it: Mapping[str, Any], *names: str) -> str:
    return ' '.join(number(it[name], 3) for name in names)


def _calm_row(scene: int, name: str, it: Mapping[str, Any]) -> list[str]:
    return [
        str(scene),
        name,
        _px(it, 'route_px', 'route_p95_px'),
        _px(it, 'goal_px', 'goal_p95_px'),
        f'{it["gross"]} ({it["gross_tracks"]}) {100 * it["gross_share"]:.2f} %',
        f'{it["fewest"]}/{it["fewest_places"]}',
        f'{100 * it["edge_share"]:.0f} %',
        f'{_px(it, "pose_x_mm", "pose_y_mm")} {number(it["pose_heading_deg"], 4)}',
        str(it['redetections']),
        f'{it["frame_ms"]:.1f} {it["slowest_ms"]:.0f}',
    ]


def _rough_row(it: Mapping[str, Any]) -> list[str]:
    back = it['recovered_after']
    return [
        str(it['scene']),
        it['disturbance'],
        _px(it, 'route_px', 'during_px'),
        _px(it, 'goal_px'),
        f'{it["gross"]} ({it["gross_tracks"]})',
        f'{it["fewest"]}/{it["fewest_places"]}',
        str(it['few_frames']),
        'never' if back is None else f'{back} frames',
        '+'.join(map(str, it['given_up'])),
        str(it['redetections']),
    ]


def _floor_rows(sizes: list[Mapping[str, Any]]) -> Iterator[str]:
    yield 'processor time a frame, anchored, one thread; ratio to one pyramid and one bare flow'
    for it in sizes:
        size = 'x'.join(map(str, it['size']))
        tracker, floor = (number(it[name], 2) for name in ('tracker_ms', 'floor_ms'))
        ratio, low, high, worst = (
            number(it[f'ratio{name}'], 2) for name in ('', '_low', '_high', '_worst')
        )
        yield (
            f'  {size:<10}{tracker:>8} ms, floor {floor} ms, ratio {ratio} (quartiles '
            f'{low} to {high}, worst frame {worst}, {number(it["worst_ms"], 1)} ms)'
        )
