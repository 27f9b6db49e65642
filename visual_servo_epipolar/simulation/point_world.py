"""Point world: a seeded cloud of features and a noisy camera, for closed loops without images."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.simulation.disturbances import Disturbances
from visual_servo_epipolar.simulation.rigs import exposed_from, SimulatedRig
from visual_servo_epipolar.simulation.sensor import (
    CameraMotion,
    DESIRED_FRAME,
    in_image,
    INSTANT,
    interpolated,
    Shutter,
    STILL,
)

BLOCK = 32  # frames drawn at once: starting a random generator costs more than drawing
TRIES = 200  # draws of pixels until the lens sees something at each
ROUNDS = 3  # to find the row that a point is read out with


@dataclass(frozen=True, kw_only=True)
class PointSettings(Settings):
    """The cloud of points, given as the goal sees it, and how well it is tracked."""

    candidates: int = setting(240, 'Points seen from the goal', low=8, high=100000)
    max_features: int = setting(60, 'Points handed on at a time', low=8, high=100000)
    noise: float = setting(0.2, 'Deviation of a pixel coordinate [px]', low=0.0, high=20.0)
    near: float = setting(3.0, 'Least depth from the goal [m]', low=0.1, high=100.0)
    far: float = setting(8.0, 'Largest depth from the goal [m]', low=0.1, high=1000.0)
    outlier_ratio: float = setting(
        0.0, 'Share of the features that are taken for another point', low=0.0, high=0.95
    )
    GONE: ClassVar[Mapping[str, Any]] = {'outlier_frames': 11}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.near >= self.far:
            raise ValueError(f'near must be below far, got {self.near:g} and {self.far:g} m')


class PointWorld:
    """
    A cloud that fills the goal's image; ``observe`` gives what a good tracker would.

    The camera of ``rig`` is the true one, its rows are exposed by ``shutter``. What
    ``disturbances`` put before the scene hides points; light and blur do nothing here.
    """

    def __init__(
        self,
        settings: PointSettings,
        rig: SimulatedRig,
        *,
        seed: int,
        disturbances: Disturbances | None = None,
        shutter: Shutter = INSTANT,
    ) -> None:
        camera = rig.camera
        self.settings, self.rig, self.camera, self._seed = settings, rig, camera, seed
        self._disturbances, self._shutter = disturbances, shutter
        rng = np.random.default_rng((seed, 2))
        pixels = _pixels_with_rays(camera, settings.candidates, rng)
        depth = settings.near + (settings.far - settings.near) * rng.random(settings.candidates)
        points = _points_seen(camera, pixels, depth)
        axes, centre = rig.camera_pose(DESIRED_POSE, DESIRED_FRAME)
        self.points: FloatArray = points @ axes.T + centre  # in the world
        self._desired = pixels + settings.noise * rng.standard_normal(pixels.shape)
        self._block, self._noises = -1, np.empty((0, *pixels.shape))

    def observe(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Features:
        """Return the features in view from ``pose``; ``frame``, 0, 1, ..., fixes their noise."""
        pixels, visible = self.project(pose, frame, motion)
        taken_for = self.taken_for(frame)
        if taken_for is not None:
            pixels, visible = pixels[taken_for], visible[taken_for]
        if self._disturbances is not None:
            visible &= ~self._disturbances.hides(pixels, frame)
        ids = np.flatnonzero(visible)[: self.settings.max_features]
        return Features(
            ids=ids,
            current=pixels[ids] + self._noise(frame)[: len(ids)],
            desired=self._desired[ids],
            ages=np.full(len(ids), frame),
            errors=np.zeros(len(ids)),
        )

    def project(
        self, pose: Pose, frame: int = DESIRED_FRAME, motion: CameraMotion = STILL
    ) -> tuple[FloatArray, BoolArray]:
        """Return the true pixels, shape (N, 2), and which of them are in view, shape (N,)."""
        camera, shutter = self.camera, self._shutter
        readout, zoom = 0.0 if frame == DESIRED_FRAME else shutter.readout, shutter.zoom(frame)
        # In axes of the camera, at the readout of the first, the middle and the last row.
        times = (0.0, 0.5 * readout, readout) if readout > 0.0 else (0.0,)
        places = [exposed_from(self.rig, pose, frame, motion, time) for time in times]
        points = np.stack([(self.points - centre) @ axes for axes, centre in places])
        pixels, visible = in_image(points[len(points) // 2], camera)
        for _ in range(ROUNDS if readout > 0.0 else 0):
            rows = np.clip(np.nan_to_num(pixels[..., 1]) / camera.height, 0.0, 1.0)
            pixels, visible = in_image(interpolated(points, rows), camera)
        if zoom != 1.0:
            centre = np.array([camera.cx, camera.cy])
            pixels = centre + zoom * (pixels - centre)
            visible = visible & camera.contains(pixels)
        return pixels, visible

    def taken_for(self, frame: int) -> IntArray | None:
        """Return which point each feature is taken for, shape (N,); None: each for itself."""
        if self.settings.outlier_ratio == 0.0:
            return None
        rng = np.random.default_rng((self._seed, 7, frame // 11))  # others each second
        count = len(self.points)
        wrong = rng.random(count) < self.settings.outlier_ratio
        return np.asarray(np.where(wrong, rng.permutation(count), np.arange(count)))

    def _noise(self, frame: int) -> FloatArray:
        """Return the noise of ``frame`` [px], a row for each feature that may be handed on."""
        block, number = divmod(frame, BLOCK)
        if block != self._block:
            rng = np.random.default_rng((self._seed, 3, block))
            shape = (BLOCK, min(self.settings.max_features, len(self.points)), 2)
            self._block, self._noises = block, self.settings.noise * rng.standard_normal(shape)
        return np.asarray(self._noises[number])


def _pixels_with_rays(camera: CameraModel, count: int, rng: np.random.Generator) -> FloatArray:
    """Return random pixels, shape (N, 2), that the lens sees something at."""
    size = [camera.width - 1, camera.height - 1]
    pixels = rng.random((count, 2)) * size
    if camera.planar is not None:
        return pixels
    for _ in range(TRIES):
        dark = ~camera.round_trips(pixels, camera.rays(pixels))
        if not dark.any():
            return pixels
        pixels[dark] = rng.random((int(dark.sum()), 2)) * size
    raise ValueError(
        'the lens sees nothing in most of its image; check focal_length and distortion'
    )


def _points_seen(camera: CameraModel, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """
    Return what is seen at ``pixels``, in axes of the camera, shape (N, 3).

    ``depth`` [m] is along the axis of a pinhole; of a wider lens it is the distance.
    """
    if camera.planar is not None:
        return np.column_stack([camera.planar.image_points(pixels) * depth[:, None], depth])
    return np.asarray(camera.rays(pixels) * depth[:, None])
