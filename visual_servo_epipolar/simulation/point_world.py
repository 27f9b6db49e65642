"""Point features without images: a seeded cloud seen by a noisy camera, for fast closed loops."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.camera import Camera
from visual_servo_epipolar.core.features import Features
from visual_servo_epipolar.core.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.settings import setting, Settings

MIN_DEPTH_M = 0.3


@dataclass(frozen=True, kw_only=True)
class PointSettings(Settings):
    """The cloud of points, given as the goal sees it, and the noise of its image."""

    candidates: int = setting(240, 'Points seen from the goal', low=8, high=100000)
    max_features: int = setting(60, 'Points handed on at a time', low=8, high=100000)
    noise: float = setting(0.2, 'Deviation of a pixel coordinate [px]', low=0.0, high=20.0)
    near: float = setting(3.0, 'Least depth from the goal [m]', low=0.1, high=100.0)
    far: float = setting(8.0, 'Largest depth from the goal [m]', low=0.1, high=1000.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.near >= self.far:
            raise ValueError(f'near must be below far, got {self.near:g} and {self.far:g} m')


class PointWorld:
    """A cloud that fills the goal's image; ``observe`` gives what a perfect tracker would."""

    def __init__(self, settings: PointSettings, camera: Camera, *, seed: int) -> None:
        self.settings = settings
        self.camera = camera
        rng = np.random.default_rng((seed, 2))
        size = [camera.width - 1, camera.height - 1]
        pixels = rng.random((settings.candidates, 2)) * size
        depth = settings.near + (settings.far - settings.near) * rng.random(settings.candidates)
        # Camera axes of the goal: x right, z forward; the plane of the paper has y forward.
        self._points = np.column_stack([camera.rays(pixels) * depth[:, None], depth])
        self._seed = seed
        self._desired = pixels + settings.noise * rng.standard_normal(pixels.shape)

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features in view from ``pose``; ``frame`` fixes their noise."""
        rng = np.random.default_rng((self._seed, 3, frame))
        pixels, visible = self.project(pose)
        noisy = pixels + self.settings.noise * rng.standard_normal(pixels.shape)
        ids = np.flatnonzero(visible)[: self.settings.max_features]
        return Features(
            ids=ids,
            current=noisy[ids],
            desired=self._desired[ids],
            ages=np.full(len(ids), frame),
            errors=np.zeros(len(ids)),
        )

    def project(self, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the true pixels, shape (N, 2), and which of them are in view, shape (N,)."""
        alpha = pose.theta - DESIRED_POSE.theta
        cosine, sine = math.cos(alpha), math.sin(alpha)
        x, z = self._points[:, 0] - pose.x, self._points[:, 2] - pose.y
        right, forward = cosine * x + sine * z, -sine * x + cosine * z
        ahead = forward > MIN_DEPTH_M
        depth = np.where(ahead, forward, 1.0)
        rays = np.stack([right / depth, self._points[:, 1] / depth], axis=1)
        pixels = self.camera.pixels(np.clip(rays, -10.0, 10.0))
        return pixels, ahead & self.camera.contains(pixels)
