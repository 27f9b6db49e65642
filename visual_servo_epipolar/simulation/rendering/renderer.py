"""The image of a scene through a camera, sub-pixel exact, and the truth behind each pixel."""

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray, Image
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount
from visual_servo_epipolar.simulation.rendering.raster import NEAR, rasterize, View
from visual_servo_epipolar.simulation.rendering.sampling import shade
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

MAX_RAY = 4.0  # what a distorting lens shows farther from the axis stays black (76 deg)
SAME_PLACE = 0.01  # deviation of a traced point that is still the same surface, relative to depth


class Renderer:
    """
    What ``camera`` on a robot sees of ``scene``; the same inputs give the same bits.

    ``tilt`` and ``roll`` [rad] add to those of the mount: the jitter of an uneven floor.
    """

    def __init__(self, scene: Scene, camera: Camera, mount: CameraMount | None = None) -> None:
        self.scene, self.camera = scene, camera
        self.mount = CameraMount() if mount is None else mount
        self._canvas, self._maps = _canvas_of(camera)

    def render(self, pose: Pose, *, tilt: float = 0.0, roll: float = 0.0) -> Image:
        """Return the image taken from ``pose``, shape (H, W)."""
        view = self._view(pose, tilt, roll)
        image = shade(self.scene, view, rasterize(self.scene, view))
        if self._maps is None:
            return image
        # Cubic sampling would shift details by 0.03 px, Lanczos' by less than 0.01 px.
        distorted = cv2.remap(image, *self._maps, cv2.INTER_LANCZOS4)
        return np.asarray(distorted, dtype=np.uint8)

    def project(
        self, points: FloatArray, pose: Pose, *, tilt: float = 0.0, roll: float = 0.0
    ) -> tuple[FloatArray, BoolArray]:
        """
        Project world ``points``, shape (N, 3), whether or not something hides them.

        Returns
        -------
        pixels : array, shape (N, 2)
            NaN for points behind the camera.
        visible : array of bool, shape (N,)
            Whether the point is ahead of the camera and in the image.

        """
        rays = self._view(pose, tilt, roll).to_camera(np.asarray(points, dtype=np.float64))
        ahead = rays[:, 2] > NEAR
        pixels = np.full((len(rays), 2), np.nan)
        if ahead.any():
            pixels[ahead] = self.camera.pixels(rays[ahead, :2] / rays[ahead, 2:])
        return pixels, ahead & self.camera.contains(pixels)

    def trace(
        self, pixels: FloatArray, pose: Pose, *, tilt: float = 0.0, roll: float = 0.0
    ) -> FloatArray:
        """Return the world points seen at ``pixels``, shape (N, 3); NaN where there is none."""
        view, scene = self._view(pose, tilt, roll), self.scene
        rays = np.column_stack(
            [self.camera.rays(as_points(pixels, 'pixels')), np.ones(len(pixels))]
        )
        directions = rays @ view.R_world_camera.T
        origins = scene.corners[:, 0] - view.centre
        with np.errstate(divide='ignore', invalid='ignore'):
            depths = (origins * scene.normals).sum(axis=1) / (directions @ scene.normals.T)
            hits = depths[..., None] * directions[:, None] - origins
            inside = (depths > NEAR) & scene.facing(view.centre)
            for k in (1, 3):
                edge = scene.corners[:, k] - scene.corners[:, 0]
                share = (hits * edge).sum(axis=-1) / (edge**2).sum(axis=-1)
                inside &= (share >= 0.0) & (share <= 1.0)
        nearest = np.where(inside, depths, np.inf).min(axis=1)
        nearest[np.isinf(nearest)] = np.nan
        return np.asarray(view.centre + nearest[:, None] * directions)

    def unhidden(self, points: FloatArray, pixels: FloatArray, pose: Pose) -> BoolArray:
        """Return which ``points``, that project to ``pixels``, nothing in the scene hides."""
        met = self.trace(pixels, pose)
        distance = np.linalg.norm(points - self.mount.centre(pose), axis=1)
        return np.asarray(np.linalg.norm(met - points, axis=1) <= SAME_PLACE * distance)

    def _view(self, pose: Pose, tilt: float, roll: float) -> View:
        width, height, intrinsics = self._canvas
        axes = self.mount.R_world_camera(pose, tilt=tilt, roll=roll)
        return View(width, height, intrinsics, self.mount.centre(pose), axes)


def _canvas_of(
    camera: Camera,
) -> tuple[tuple[int, int, FloatArray], tuple[np.ndarray, np.ndarray] | None]:
    """Return size and intrinsics of the pinhole image to draw, and the maps to distort it."""
    if not camera.distorts:
        return (camera.width, camera.height, camera.matrix), None
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    ideal = np.clip(rays, -MAX_RAY, MAX_RAY) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    shift = 4.0 - np.floor(ideal.min(axis=0))  # the sampling reaches four pixels out
    width, height = (np.ceil(ideal.max(axis=0)) + shift + 5.0).astype(int).tolist()
    intrinsics = camera.matrix
    intrinsics[:2, 2] += shift
    maps = (ideal + shift).astype(np.float32).reshape(camera.height, camera.width, 2)
    return (width, height, intrinsics), (maps[..., 0].copy(), maps[..., 1].copy())
