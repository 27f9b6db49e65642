"""
Tracking benchmark: errors of features along rendered approaches, and time.

Errors are those of trackable features. A gross error is a feature reported as good, off the edges
of depth, more than GROSS from its place, whether or not that place is hidden: nothing flagged it.
Those on edges of depth are counted apart, for they have no single true place.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from time import perf_counter
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.tables import aligned, cells, Columns, numbers
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.rendering.renderer import Renderer

STANDING = 5  # last frames, at the goal
BRAKING = 20  # frames before those
RING = 3 * np.array([(1, 0), (0, 1), (1, 1), (1, -1)])  # where depth around a feature is seen [px]


def approach(start: tuple[float, float], frames: int) -> list[Pose]:
    """
    Return poses from ``start``, (x, y) [m], to the goal, the last ``STANDING`` of them at it.

    Along x = x0 (y / y0)^2, looking along the path: it arrives looking along +y. The speed is
    constant until the robot brakes.
    """
    x, y = start
    pace = np.clip(np.arange(frames - STANDING)[::-1] / BRAKING, 0.0, 1.0)
    remaining = 1.0 - np.cumsum(pace) / pace.sum()
    remaining = np.concatenate([remaining, np.zeros(STANDING)]).tolist()
    headings = [math.atan2(-y, -2.0 * x * share) for share in remaining]
    return [
        Pose(x * share**2, y * share, heading)
        for share, heading in zip(remaining, headings, strict=True)
    ]


def start_of(seed: int, frames: int) -> tuple[float, float]:
    """Return a start (x, y) [m] 3 to 5.5 m behind the goal; nearer when there are few frames."""
    rng = np.random.default_rng((seed, 6))
    side = -1.0 if rng.random() < 0.5 else 1.0
    shorter = min(1.0, frames / 200.0)
    return side * rng.uniform(0.3, 0.6) * shorter, -rng.uniform(3.0, 5.5) * shorter


@dataclass(frozen=True, slots=True, eq=False)
class FrameErrors:
    """
    Errors of the features of one frame, rows are features.

    ``distances``, shape (N,): of each feature from its true place [px], infinite for a point
    behind the camera. ``on_edge``, shape (N,): it sits on an edge of depth, and has no single true
    place. ``trackable``, shape (N,): off edges, in the image, and nothing hides it.
    """

    features: Features
    distances: FloatArray
    on_edge: BoolArray
    trackable: BoolArray


class TrueFeatures:
    """Ground truth: where the features of the desired view are, by the geometry of the room."""

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self._points: dict[tuple[float, float], tuple[FloatArray, bool]] = {}

    def errors(self, features: Features, pose: Pose) -> FrameErrors:
        """Return the errors of ``features``, tracked from ``pose``."""
        points, on_edge = self.points(features.desired)
        pixels, inside = self.renderer.project(points, pose)
        axes, centre = self.renderer.rig.camera_pose(pose)
        ahead = (points - centre) @ axes[:, 2] > 0.0
        visible = inside.copy()
        visible[inside] = self.renderer.unhidden(points[inside], pixels[inside], pose)
        distances = np.where(ahead, np.hypot(*(features.current - pixels).T), np.inf)
        return FrameErrors(features, distances, on_edge, ~on_edge & visible)

    def points(self, desired: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the points [m], (N, 3), of desired pixels, (N, 2), and which are on edges."""
        keys = [(float(u), float(v)) for u, v in desired]
        new = [key for key in dict.fromkeys(keys) if key not in self._points]
        if new:
            pixels = np.array(new)
            traced, edges = self.renderer.trace(pixels, DESIRED_POSE), self._on_edge(pixels)
            self._points |= dict(zip(new, zip(traced, edges.tolist(), strict=True), strict=True))
        points = np.array([self._points[key][0] for key in keys]).reshape(-1, 3)
        return points, np.array([self._points[key][1] for key in keys], bool)

    def _on_edge(self, pixels: FloatArray) -> BoolArray:
        """Return around which pixels the depth is not smooth."""
        on_edge, here = np.zeros(len(pixels), bool), self._inverse_depth(pixels)
        for step in RING:
            both = self._inverse_depth(pixels + step) + self._inverse_depth(pixels - step)
            # Of a plane, inverse depth is linear in the pixel. NaN, no surface, is an edge.
            on_edge |= ~(np.abs(both - 2.0 * here) <= 0.02 * here)  # a bend
        return on_edge

    def _inverse_depth(self, pixels: FloatArray) -> FloatArray:
        axes, centre = self.renderer.rig.camera_pose(DESIRED_POSE)
        away = self.renderer.trace(pixels, DESIRED_POSE) - centre
        return np.asarray(1.0 / (away @ axes[:, 2]))


SCENES = (101, 102, 103, 104, 105)  # none of them served to tune the tracker
CONFIGURATIONS: Mapping[str, Mapping[str, Any]] = {
    'anchored': {},
    'frame to frame': {'anchor_period': 0},
}
GROSS = 3.0  # a feature farther than this from its place is a wrong one [px]
ENOUGH = 26  # features of the paper's experiments
COLUMNS: Columns = {
    'scene': lambda row: str(row['scene']),
    'tracker': lambda row: str(row['name']),
    'en route med / p95': lambda row: numbers((row['route_px'], row['route_p95_px']), 3),
    'at goal med / p95': lambda row: numbers((row['goal_px'], row['goal_p95_px']), 3),
    'gross share': lambda row: f'{row["gross"]} {100 * row["gross_share"]:.2f} %',
    'fewest': lambda row: str(row['fewest']),
    f'frames < {ENOUGH}': lambda row: str(row['few_frames']),
    'ms med / max': lambda row: f'{row["frame_ms"]:.1f} / {row["slowest_ms"]:.0f}',
}


@dataclass(frozen=True, slots=True)
class TrackingPlan:
    """How much is done: scenes, frames, camera."""

    scenes: Sequence[int] = SCENES
    frames: int = 200
    camera: CameraSettings = CameraSettings(noise=2.0, gain_drift=0.05)


QUICK = TrackingPlan(SCENES[:1], 40, TrackingPlan().camera.resized(640, 480))


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document of the benchmark; ``say`` takes the progress."""
    return measure(QUICK if quick else TrackingPlan(), seed, say)


def measure(plan: TrackingPlan, seed: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Carry out ``plan``: a row for each tracker of each scene."""
    rows: list[dict[str, Any]] = []
    for scene in plan.scenes:
        rows += [{'scene': scene, **it} for it in _scene(plan, scene, seed, say)]
    size = [plan.camera.width, plan.camera.height]
    return {'seed': seed, 'frames': plan.frames, 'size': size, 'rows': rows}


def _scene(
    plan: TrackingPlan, scene: int, seed: int, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Return the figures of all configurations in one scene."""
    world = CameraSimulator(replace(plan.camera, scene_seed=scene, seed=seed + scene))
    truth, desired = TrueFeatures(world.renderer), world.photograph()
    trackers = {name: _tracker(desired, **how) for name, how in CONFIGURATIONS.items()}
    errors: dict[str, list[FrameErrors]] = {name: [] for name in trackers}
    seconds: dict[str, list[float]] = {name: [] for name in trackers}
    for frame, pose in enumerate(approach(start_of(seed + scene, plan.frames), plan.frames)):
        say(f'scene {scene}: frame {frame + 1} of {plan.frames}')
        image = world.capture(pose, frame)
        for name, tracker in trackers.items():
            began = perf_counter()
            features = tracker.track(image)
            seconds[name].append(perf_counter() - began)
            errors[name].append(truth.errors(features, pose))
    return [
        {
            'name': name,
            **scores(errors[name]),
            'frame_ms': 1e3 * float(np.median(seconds[name][1:])),
            'slowest_ms': 1e3 * max(seconds[name][1:]),
        }
        for name in trackers
    ]


def _tracker(desired: Image, **changes: Any) -> Tracker:
    tracker = Tracker(TrackerSettings(**changes))
    tracker.set_desired(desired)
    return tracker


def scores(frames: Sequence[FrameErrors]) -> dict[str, Any]:
    """Return the figures of one run."""
    counts = [len(each.features) for each in frames]
    gross = sum(int((~each.on_edge & (each.distances > GROSS)).sum()) for each in frames)
    judged = sum(int((~each.on_edge).sum()) for each in frames)
    return {
        'route_px': _percentile(frames[:-STANDING], 50.0),
        'route_p95_px': _percentile(frames[:-STANDING], 95.0),
        'goal_px': _percentile(frames[-STANDING:], 50.0),
        'goal_p95_px': _percentile(frames[-STANDING:], 95.0),
        'gross': gross,
        'gross_share': gross / max(judged, 1),
        'fewest': min(counts),
        'few_frames': sum(count < ENOUGH for count in counts),
    }


def _percentile(frames: Sequence[FrameErrors], share: float) -> float | None:
    """Return a percentile of the errors of trackable features; None without any."""
    errors = np.concatenate([*(each.distances[each.trackable] for each in frames), np.empty(0)])
    return float(np.percentile(errors, share)) if len(errors) else None


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a tracker."""
    width, height = document['size']
    return '\n'.join(
        [
            f'Tracking, {document["frames"]} rendered frames of {width}x{height} a scene, '
            'errors in px against ground truth',
            '',
            *aligned(' | '.join(COLUMNS), cells(COLUMNS, document['rows']), left=2),
        ]
    )
