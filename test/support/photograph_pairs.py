"""
Pairs of photographs as hands, phones and cars take them: matches in pixels with the truth.

What rendered rooms lack: a tilt that changes and a camera that climbs between the views, facades
that repeat, few and huddled matches, small baselines, residuals with tails, a camera file that is
slightly wrong. Wrong matches have passed one robust geometry, so that they lie along its lines.
"""

from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import headings
from visual_servo_epipolar.core.tracking.robust_geometry import epipolar_geometry

WIDTH, HEIGHT = 640, 480
DRAWN = 6000  # points, of which the first in view from both poses are taken
NEAREST = 0.3  # depth at which a point is no longer seen, of the nearest one
TAILS = 3.0  # degrees of freedom of Student's distribution of the noise
ROLLING_PX, FOCUS = 0.4, 0.0005  # at the first and last row; change of the focal length
STEADY, HELD = 0.25, 2.0  # share of that where nothing is in a hand; the climb of what is [deg]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """
    One kind of pair. Angles [deg]; lengths in depths of the nearest point.

    ``tilt`` and ``roll`` bound those of the camera, ``tilting`` and ``climb`` are deviations of
    their change between the views and of the way up; ``turn`` bounds the heading. ``baseline`` is
    a range; ``way`` its direction, right of the axis of the desired camera, and the deviation of
    that, None for any. ``relief`` is the range of depths over the nearest one; ``huddle`` the part
    of the view that has matches.
    """

    tilt: float = 0.0
    roll: float = 0.0
    tilting: float = 0.1
    climb: float = 0.0
    turn: float = 15.0
    baseline: tuple[float, float] = (0.1, 0.8)
    way: tuple[float, float] | None = None
    points: tuple[int, int] = (60, 500)
    relief: float = 4.0
    huddle: float = 1.0
    repeated: float = 0.0
    wrong: tuple[float, float] = (0.02, 0.3)
    noise: tuple[float, float] = (0.2, 0.8)


HAND: dict[str, Any] = {'tilt': 30.0, 'roll': 4.0, 'tilting': 3.0, 'climb': 8.0}
STEREO: dict[str, Any] = {'tilt': 20.0, 'roll': 10.0, 'tilting': 0.15, 'climb': 1.0, 'turn': 0.5}
KINDS = {
    'car': Kind(way=(180.0, 4.0), baseline=(0.2, 1.0), relief=8.0, tilting=0.15),
    'level': Kind(),
    'hand': Kind(**HAND),
    'phone': Kind(tilt=15.0, roll=8.0, tilting=8.0, climb=25.0),
    'leaning': Kind(tilt=30.0, roll=8.0),
    'facade': Kind(tilt=15.0, roll=3.0, tilting=1.0, climb=3.0, repeated=0.3, relief=1.5),
    'few': Kind(**HAND, points=(10, 45), huddle=0.7),
    'huddled': Kind(**HAND, points=(20, 120), huddle=0.35),
    'near': Kind(**HAND, baseline=(0.01, 0.06), points=(150, 600)),
    'wall': Kind(**HAND, relief=1.05),
    'aside': Kind(**HAND, turn=40.0, baseline=(0.5, 1.5), points=(12, 80), wrong=(0.1, 0.5)),
    'stereo': Kind(**STEREO, way=(90.0, 1.0), baseline=(0.03, 0.3), points=(40, 400)),
}


@dataclass(frozen=True, slots=True, eq=False)
class PhotographPair:
    """
    Matches in pixels, shape (N, 2) each, seen by a ``camera`` as its file tells it.

    ``rotation``, (3, 3), current -> desired, and ``baseline``, (3,), the current centre, are in
    axes of the desired camera, ``level``, (2, 3, 3), turns those of the desired and of the current
    camera into level ones.
    """

    current: FloatArray
    desired: FloatArray
    camera: Camera
    rotation: FloatArray
    baseline: FloatArray
    level: FloatArray

    def truth(self, *, ground: bool) -> FloatArray:
        """Return bearings, current and desired, and rotation [rad]: in the ground plane or not."""
        rotation, centre = self.rotation, self.baseline
        goal = -rotation.T @ centre
        if ground:
            desired, current = self.level
            rotation = desired @ rotation @ current.T
            centre, goal = desired @ centre, current @ goal
        bearings = math.atan2(goal[0], goal[2]), math.atan2(centre[0], centre[2])
        return np.array([*bearings, float(headings(rotation))])


def draw_photographs(kind: Kind, seed: tuple[int, ...]) -> PhotographPair:
    """Draw views until enough points are in both, then noise, tails and wrong matches."""
    rng = np.random.default_rng(seed)
    while True:
        level, rotation, baseline = _views(kind, rng)
        wanted = int(math.exp(rng.uniform(*np.log(kind.points))))
        true = _camera(rng)
        world = _points(kind, rng)
        desired, ahead = _project(world, true)
        current, seen = _project((world - baseline) @ rotation, true)
        chosen = np.flatnonzero(ahead & seen & _huddled(desired, kind, rng))[:wanted]
        if len(chosen) < min(wanted, 9):
            continue
        pixels = current[chosen], desired[chosen]
        repeats = _repeated(kind, world[chosen], (rotation, baseline), true, rng)
        noisy = _with_noise(kind, np.where(np.isnan(repeats), pixels[0], repeats), pixels[1], rng)
        noisy = noisy[0] + _rolling(kind, noisy[0], rng), noisy[1]
        _, kept = epipolar_geometry(*noisy)
        if kept.sum() >= 8:
            break
    return PhotographPair(
        noisy[0][kept], noisy[1][kept], _as_told(true, rng), rotation, baseline, level
    )


def _views(kind: Kind, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return level axes of the desired and of the current camera, rotation and baseline."""
    tilt, roll = rng.uniform(-kind.tilt, kind.tilt), rng.uniform(-kind.roll, kind.roll)
    change = rng.normal(0.0, kind.tilting, 2) * [1.0, 0.5]
    desired = rotation_level_camera(math.radians(tilt), math.radians(roll))
    current = rotation_level_camera(*np.radians([tilt + change[0], roll + change[1]]))
    heading = math.radians(rng.uniform(-kind.turn, kind.turn))
    way = rng.uniform(-180.0, 180.0) if kind.way is None else rng.normal(*kind.way)
    way, climb = math.radians(way), math.radians(rng.normal(0.0, kind.climb))
    length = math.exp(rng.uniform(*np.log(kind.baseline)))
    flat = np.array([math.sin(way), -math.tan(climb), math.cos(way)])
    rotation = desired.T @ rotation_desired_current(heading) @ current
    baseline = desired.T @ (length * flat / np.sqrt(flat @ flat))
    return np.stack([desired, current]), rotation, baseline


def _camera(rng: np.random.Generator) -> Camera:
    focal = rng.uniform(380.0, 800.0)
    centre = rng.normal([WIDTH / 2, HEIGHT / 2], 5.0)
    return Camera(WIDTH, HEIGHT, focal, focal, *centre)


def _as_told(true: Camera, rng: np.random.Generator) -> Camera:
    """Return a camera as in a good calibration: nearly the true one."""
    focal = true.fx * math.exp(rng.normal(0.0, 0.003))
    shift = rng.normal(0.0, 2.5, 2)
    distortion = (rng.normal(0.0, 0.004), 0.0, 0.0, 0.0)
    return Camera(WIDTH, HEIGHT, focal, focal, true.cx + shift[0], true.cy + shift[1], distortion)


def _points(kind: Kind, rng: np.random.Generator) -> FloatArray:
    """Return points in axes of the desired camera, shape (DRAWN, 3)."""
    depth = np.exp(rng.uniform(0.0, math.log(kind.relief), DRAWN))
    image = rng.uniform(-1.1, 1.1, (DRAWN, 2))
    if kind.repeated or kind.relief < 1.2:
        depth *= 1.0 / np.maximum(1.0 + image @ rng.uniform(-0.4, 0.4, 2), 0.2)
    return np.asarray(np.column_stack([image, np.ones(DRAWN)]) * depth[:, None])


def _project(points: FloatArray, camera: Camera) -> tuple[FloatArray, BoolArray]:
    """Return pixels of points in camera axes, (N, 3), and which are in view."""
    depth = np.where(points[:, 2] > NEAREST, points[:, 2], np.inf)
    pixels = camera.pixels_of(points[:, :2] / depth[:, None])
    inside = (pixels > 8.0).all(axis=1) & (pixels < [WIDTH - 8.0, HEIGHT - 8.0]).all(axis=1)
    return pixels, np.isfinite(depth) & inside


def _huddled(pixels: FloatArray, kind: Kind, rng: np.random.Generator) -> BoolArray:
    """Return which pixels are within the part of the view that has matches."""
    size = kind.huddle * np.array([WIDTH, HEIGHT])
    corner = rng.uniform(0.0, np.array([WIDTH, HEIGHT]) - size)
    return np.asarray(((pixels >= corner) & (pixels <= corner + size)).all(axis=1))


def _rolling(kind: Kind, pixels: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return how pixels move in a view whose rows are read one after the other, (N, 2)."""
    rows = pixels[:, 1:] / (HEIGHT / 2) - 1.0
    focus = (pixels - [WIDTH / 2, HEIGHT / 2]) * rng.normal(0.0, FOCUS)
    rolling = ROLLING_PX if kind.climb > HELD else STEADY * ROLLING_PX
    return np.asarray(rows * rng.normal(0.0, rolling, 2) + focus)


def _repeated(
    kind: Kind,
    world: FloatArray,
    views: tuple[FloatArray, FloatArray],
    camera: Camera,
    rng: np.random.Generator,
) -> FloatArray:
    """Return current pixels, (N, 2), of what was taken for its neighbour; nan of the others."""
    rotation, baseline = views
    period = rng.uniform(0.25, 0.8) * np.array([1.0, 0.0, rng.uniform(-0.4, 0.4)])
    pixels, seen = _project((world + period - baseline) @ rotation, camera)
    swapped = seen & (rng.uniform(size=len(world)) < kind.repeated)
    return np.asarray(np.where(swapped[:, None], pixels, np.nan))


def _with_noise(
    kind: Kind, current: FloatArray, desired: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return noisy pixels with wrong matches: half anywhere, half near where they belong."""
    count = len(current)
    deviation = math.exp(rng.uniform(*np.log(kind.noise))) * math.sqrt((TAILS - 2.0) / TAILS)
    noise = deviation * rng.standard_t(TAILS, (2, count, 2))
    wrong = rng.uniform(size=count) < rng.uniform(*kind.wrong)
    near = current + rng.normal(0.0, 12.0, (count, 2))
    anywhere = rng.uniform(0.0, [WIDTH, HEIGHT], (count, 2))
    other = np.where(rng.uniform(size=count)[:, None] < 0.5, near, anywhere)
    return np.where(wrong[:, None], other, current + noise[0]), desired + noise[1]
