"""The image of a scene through a camera, sub-pixel exact, and the truth behind each pixel."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray, Image
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.mounts.rig import CameraRig
from visual_servo_epipolar.simulation.rendering.raster import NEAR, rasterize, View
from visual_servo_epipolar.simulation.rendering.sampling import shade
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

Map: TypeAlias = NDArray[np.float32]

MAX_RAY = 4.0  # what a distorting lens shows farther from the axis stays black (76 deg)
SAME_PLACE = 0.01  # deviation of a traced point still on its surface, relative to depth


class Renderer:
    """
    Images of ``scene`` through the camera of a robot; equal inputs give equal bits.

    ``rig`` may be replaced by another with an equal camera. ``pose`` is the robot's, and ``frame``
    that for which the rig is asked where the camera is.
    """

    def __init__(self, scene: Scene, rig: CameraRig) -> None:
        self.scene, self.camera, self.rig = scene, rig.camera, rig
        self._canvas, self._maps = _canvas_of(rig.camera)

    def render(self, pose: Pose, frame: int | None = None) -> Image:
        """Return the image taken from ``pose``, shape (H, W)."""
        view = self._view(pose, frame)
        image = shade(self.scene, view, rasterize(self.scene, view))
        if self._maps is None:
            return image
        # Cubic sampling would shift details by 0.03 px, Lanczos' by less than 0.01 px.
        distorted = cv2.remap(image, *self._maps, cv2.INTER_LANCZOS4)
        return np.asarray(distorted, dtype=np.uint8)

    def project(
        self, points: FloatArray, pose: Pose, frame: int | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """
        Project world ``points`` [m], shape (N, 3), whether or not something hides them.

        Returns
        -------
        pixels : array, shape (N, 2)
            NaN for points behind the camera.
        visible : array of bool, shape (N,)
            Whether the point is ahead of the camera and in the image.

        """
        rays = self._view(pose, frame).to_camera(np.asarray(points, dtype=np.float64))
        ahead = rays[:, 2] > NEAR
        pixels = np.full((len(rays), 2), np.nan)
        if ahead.any():
            pixels[ahead] = self.camera.pixels_of(rays[ahead, :2] / rays[ahead, 2:])
        return pixels, ahead & self.camera.contains(pixels)

    def trace(self, pixels: FloatArray, pose: Pose, frame: int | None = None) -> FloatArray:
        """
        Return the world points [m], shape (N, 3), seen at ``pixels``, shape (N, 2).

        They are NaN where there is no surface.
        """
        view, scene = self._view(pose, frame), self.scene
        rays = np.column_stack(
            [self.camera.image_points(as_points(pixels, 'pixels')), np.ones(len(pixels))]
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
        """
        Return which points nothing in the scene hides, shape (N,), on a level floor.

        ``points`` [m], shape (N, 3), project to ``pixels``, shape (N, 2).
        """
        nearest = self.trace(pixels, pose)
        distance = np.linalg.norm(points - self.rig.camera_pose(pose).centre, axis=1)
        return np.asarray(np.linalg.norm(nearest - points, axis=1) <= SAME_PLACE * distance)

    def _view(self, pose: Pose, frame: int | None) -> View:
        width, height, intrinsics = self._canvas
        axes, centre = self.rig.camera_pose(pose, frame)
        return View(width, height, intrinsics, centre, axes)


def _canvas_of(
    camera: Camera,
) -> tuple[tuple[int, int, FloatArray], tuple[Map, Map] | None]:
    """Return size and intrinsics of the pinhole image to draw, and the maps to distort it."""
    if not camera.distorts:
        return (camera.width, camera.height, camera.matrix), None
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    rays = camera.image_points(np.stack([u.ravel(), v.ravel()], axis=1))
    ideal = np.clip(rays, -MAX_RAY, MAX_RAY) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    shift = 4.0 - np.floor(ideal.min(axis=0))  # the sampling reaches four pixels out
    width, height = (np.ceil(ideal.max(axis=0)) + shift + 5.0).astype(int).tolist()
    intrinsics = camera.matrix
    intrinsics[:2, 2] += shift
    maps = (ideal + shift).astype(np.float32).reshape(camera.height, camera.width, 2)
    return (width, height, intrinsics), (maps[..., 0].copy(), maps[..., 1].copy())
