"""Tracking benchmark: accuracy, robustness and speed on rendered approaches."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.benchmarks.tracking.scores import (
    ended_tracks,
    recovery_time,
    scores,
    table,
)
from visual_servo_epipolar.evaluation.benchmarks.tracking.timing import over_floor, times
from visual_servo_epipolar.evaluation.benchmarks.tracking.world import (
    approach,
    FrameErrors,
    RenderedWorld,
    start_of,
    TrueFeatures,
)
from visual_servo_epipolar.simulation.disturbances.image import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

__all__ = ['run', 'table']

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
    """
    How much is done.

    Scenes, how many of them disturbed and how, frames, camera; whether time on a ``single``
    thread is taken, too.
    """

    scenes: Sequence[int] = SCENES
    disturbed: int = DISTURBED_SCENES
    frames: int = 200
    camera: CameraSettings = CameraSettings(noise=2.0, gain_drift=0.05)
    disturbances: Sequence[str] = tuple(DISTURBANCES)
    single: bool = True


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
    single=False,
)


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document of the benchmark; ``say`` is told the progress."""
    return measure(QUICK if quick else TrackingPlan(), seed, say)


def measure(plan: TrackingPlan, seed: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Carry out ``plan``."""
    scenes: list[dict[str, Any]] = []
    disturbed: list[dict[str, Any]] = []
    kept: list[Image] = []
    for number, scene in enumerate(plan.scenes):
        names = plan.disturbances if number < plan.disturbed else ()
        keep = TIMED if number == 0 else 0
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
        'time': times(kept[0], kept[1:], single=plan.single),
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
