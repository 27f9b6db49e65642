"""
Sequences: a robot drives home by features of which some are wrong all the way.

A look-alike (the next lamp post, the next tube of a scaffolding) that was found along the epipolar
line fits the geometry in every frame; only its depth is wrong: beyond infinity.
"""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

SIZE = np.array([640.0, 480.0])
CAMERA = Camera(640, 480, 500.0, 500.0, 320.0, 240.0)
DRAWN, FRAMES = 3000, 40  # points, of which the first in view all the way are taken
INVERSE_DEPTHS = (0.17, 0.5)  # of features [1/m]
END = 0.1  # of the way, where the sequence ends
BEYOND = (0.3, 1.2)  # of the inverse depth: how far beyond infinity a look-alike is
ELSEWHERE = 0.1  # tangent by which another point is aside that was taken for a feature


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """
    One kind of drive: a range of ``features`` in a ``huddle``, which is a part of the view.

    ``alike`` and ``elsewhere`` are the shares that are on a look-alike beyond infinity, and on
    another point nearby; ``noise`` is the deviation of pixels, half of it the same all the way.
    """

    features: tuple[int, int] = (12, 20)
    huddle: float = 0.5
    alike: float = 0.0
    elsewhere: float = 0.1
    noise: float = 0.4


DRIVES = {
    'few': Drive(),
    'huddled': Drive(huddle=0.3),
    'many': Drive(features=(40, 80), huddle=1.0),
    'alike': Drive(features=(24, 34), huddle=0.9, alike=0.3, elsewhere=0.0),
    'elsewhere': Drive(features=(24, 40), huddle=0.8, elsewhere=0.3),
    'noisy': Drive(noise=1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Poses (right, ahead, heading [deg]) as seen by a camera whose ``level`` axes are (3, 3)."""

    level: FloatArray
    poses: FloatArray

    def current(self, rays: FloatArray, inverse_depth: FloatArray, frame: int) -> FloatArray:
        """Return where points are in a ``frame``, by rays of z = 1 in the goal's axes, (N, 3)."""
        right, ahead, heading = self.poses[frame]
        centre = self.level.T @ [right, 0.0, ahead]
        rotation = self.level.T @ rotation_desired_current(math.radians(heading)) @ self.level
        return np.asarray((rays - inverse_depth[:, None] * centre) @ rotation)


def driven(
    drive: Drive, seed: tuple[int, ...], settings: PerceptionSettings
) -> Iterator[tuple[Bearings, Measurement]]:
    """Return the true bearings and what is measured, frame by frame on the way home."""
    rng = np.random.default_rng(seed)
    scene, rays, inverse_depth = _scene(drive, rng)
    share = math.sqrt(0.5) * drive.noise
    desired = _pixels(rays) + rng.normal(0.0, share, (len(rays), 2))
    drift = rng.normal(0.0, share, desired.shape)
    alike, elsewhere = rng.uniform(size=(2, len(rays))) < [[drive.alike], [drive.elsewhere]]
    beyond = -inverse_depth * rng.uniform(*BEYOND, len(rays))
    inverse_depth = np.where(alike, beyond, inverse_depth)
    aside = rng.normal(0.0, ELSEWHERE, rays.shape) * [1.0, 1.0, 0.0]
    rays = rays + elsewhere[:, None] * aside
    memory = None
    for frame, pose in enumerate(scene.poses):
        current = _pixels(scene.current(rays, inverse_depth, frame)) + drift
        current += rng.normal(0.0, share, drift.shape)
        found = perceive(_observation(current, desired, frame), settings, frame, memory)
        memory = found.memory
        yield Bearings.from_pose(Pose.from_start(*pose.tolist())), found.measurement


def error_deg(true: Bearings, found: Bearings) -> float:
    """Return the larger error of both bearings [deg]."""
    away = found.psi - true.psi, found.phi - true.phi
    return max(abs(math.degrees(math.remainder(each, 2.0 * math.pi))) for each in away)


def _scene(drive: Drive, rng: np.random.Generator) -> tuple[Scene, FloatArray, FloatArray]:
    """Return a scene, rays of features in the goal's axes, (N, 3), and inverse depths, (N,)."""
    huddle = drive.huddle * SIZE
    while True:
        count = int(rng.integers(*drive.features))
        start = rng.uniform([-1.0, -4.0, -12.0], [1.0, -1.5, 12.0])
        tilt, roll = rng.uniform(-10.0, 10.0), rng.uniform(-2.0, 2.0)
        level = rotation_level_camera(math.radians(tilt), math.radians(roll))
        scene = Scene(level, np.linspace(1.0, END, FRAMES)[:, None] * start)
        rays = np.column_stack([rng.uniform(-0.6, 0.6, (DRAWN, 2)), np.ones(DRAWN)])
        inverse_depth = rng.uniform(INVERSE_DEPTHS[0], INVERSE_DEPTHS[1], DRAWN)
        corner = rng.uniform(0.0, 1.0, 2) * (SIZE - huddle)
        inside = ((_pixels(rays) > corner) & (_pixels(rays) < corner + huddle)).all(axis=1)
        for frame in (0, FRAMES - 1):
            inside &= _in_view(scene.current(rays, inverse_depth, frame))
        chosen = np.flatnonzero(inside)[:count]
        if len(chosen) == count:
            return scene, rays[chosen], inverse_depth[chosen]


def _in_view(points: FloatArray) -> BoolArray:
    """Return which points in axes of a camera, (N, 3), it has in view."""
    pixels = _pixels(points)
    return np.asarray((points[:, 2] > 0.0) & ((pixels > 0.0) & (pixels < SIZE)).all(axis=1))


def _pixels(points: FloatArray) -> FloatArray:
    return CAMERA.pixels_of(points[:, :2] / points[:, 2:])


def _observation(current: FloatArray, desired: FloatArray, frame: int) -> Observation:
    rays = CAMERA.rays(current), CAMERA.rays(desired)
    angles = np.stack([CAMERA.resolution(each) for each in rays], axis=1)
    ids = np.arange(len(current))
    return Observation(frame, *rays, CAMERA.focal, pixel_angles=angles, ids=ids)
