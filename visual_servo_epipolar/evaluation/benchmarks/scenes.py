"""Synthetic pairs of views with true bearings."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera, unit_rays

FOCAL = 770.0  # [px]
HALF_VIEW = np.array([635.0, 512.0]) / FOCAL  # tangents of half the field of view
NEAREST = 0.5  # depth at which a point is no longer seen [m]
MAX_HEADING = 15.0  # and looks this much to the side at most [deg]
DRAWN = 4000  # points, of which the first in view from both poses are taken


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """
    One kind of pair: baseline [m], noise [px], share of outliers, camera [deg], scene.

    ``jitter`` is the deviation of tilt and of roll in each view; ``scene`` one of lab (points 3
    to 8 m deep), slanted (one vertical wall, 17 deg off frontal) and frontal (one wall).
    ``around`` puts the robot anywhere around the goal instead of behind it.
    """

    baseline: float
    points: int = 26
    noise: float = 0.3
    outliers: float = 0.0
    tilt: float = 0.0
    roll: float = 0.0
    jitter: float = 0.0
    scene: str = 'lab'
    around: bool = False

    @property
    def ray_noise(self) -> float:
        """Deviation of a coordinate at unit focal length: of an angle on the optical axis."""
        return self.noise / FOCAL


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """
    Unit rays of the matches, shape (N, 3) each, and the true bearings.

    ``noise``, shape (N, 2), are the deviations of the angles of current and desired rays [rad].
    """

    current: FloatArray
    desired: FloatArray
    noise: FloatArray
    bearings: Bearings


def draw_pair(cell: Cell, rng: np.random.Generator) -> Pair:
    """Draw poses until enough points are in view of both, then noise and outliers."""
    while True:
        pose = _pose(cell, rng)
        points = _points(cell, rng)
        rotation = rotation_desired_current(pose.heading_error)
        desired, ahead_d = _image(points, cell, rng)
        current, ahead_a = _image((points - [pose.x, 0.0, pose.y]) @ rotation, cell, rng)
        chosen = np.flatnonzero(ahead_d & ahead_a)[: cell.points]
        if len(chosen) == cell.points:
            break
    noise = rng.normal(0.0, cell.ray_noise, (2, cell.points, 2))
    current, desired = current[chosen] + noise[0], desired[chosen] + noise[1]
    wrong = round(cell.outliers * cell.points)
    current[:wrong] = rng.uniform(-HALF_VIEW, HALF_VIEW, (wrong, 2))
    truth = Bearings.from_pose(pose) if cell.baseline else Bearings(math.nan, math.nan)
    rays = unit_rays(current), unit_rays(desired)
    return Pair(
        current=rays[0],
        desired=rays[1],
        noise=cell.ray_noise * np.stack([rays[0][:, 2], rays[1][:, 2]], axis=1) ** 1.5,
        bearings=truth,
    )


def draw_pairs(cell: Cell, count: int, seed: int) -> list[Pair]:
    """Draw ``count`` pairs, each from a generator of its own."""
    return [draw_pair(cell, np.random.default_rng((seed, k))) for k in range(count)]


def _pose(cell: Cell, rng: np.random.Generator) -> Pose:
    width = 180.0 if cell.around else 40.0  # behind the goal [deg]
    angle = math.radians(rng.uniform(-width, width))
    heading = rng.uniform(-MAX_HEADING, MAX_HEADING)
    x, y = cell.baseline * math.sin(angle), -cell.baseline * math.cos(angle)
    return Pose.from_start(x, y, heading)


def _points(cell: Cell, rng: np.random.Generator) -> FloatArray:
    """Return points in camera axes of the goal, shape (DRAWN, 3)."""
    x, y = rng.uniform(-5.0, 5.0, DRAWN), rng.uniform(-1.8, 0.45, DRAWN)
    depth = rng.uniform(3.0, 8.0, DRAWN)
    if cell.scene != 'lab':
        depth = 5.5 + (0.3 * x if cell.scene == 'slanted' else 0.0 * x)
    return np.stack([x, y, depth], axis=1)


def _image(
    points: FloatArray, cell: Cell, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Return image-plane points in a camera with tilt, roll and jitter, and which are in view."""
    tilt, roll = np.radians([cell.tilt, cell.roll] + cell.jitter * rng.standard_normal(2))
    vectors = points @ rotation_level_camera(tilt, roll)
    depth = np.where(vectors[:, 2] > NEAREST, vectors[:, 2], np.inf)
    image = vectors[:, :2] / depth[:, None]
    return image, np.isfinite(depth) & (np.abs(image) < HALF_VIEW).all(axis=1)


def error(estimated: Bearings, true: Bearings) -> float:
    """Return the root mean square angle between estimated and true epipoles [deg]."""
    psi, phi = math.sin(estimated.psi - true.psi), math.sin(estimated.phi - true.phi)
    return math.degrees(math.hypot(math.asin(abs(psi)), math.asin(abs(phi))) / math.sqrt(2.0))
