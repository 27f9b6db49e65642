"""The image of a scene through a camera, sub-pixel exact, and the truth behind each pixel."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel, PlanarCamera
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.simulation.mounts.simulated_rig import (
    CameraPose,
    lenses_of,
    SimulatedRig,
)
from visual_servo_epipolar.simulation.rendering.assistant import Assistant, draw
from visual_servo_epipolar.simulation.rendering.faces import Faces
from visual_servo_epipolar.simulation.rendering.raster import NEAR, PinholeView
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

Map: TypeAlias = NDArray[np.float32]

MAX_RAY = 4.0  # what a distorting lens shows farther from the axis stays black (76 deg)
SAME_PLACE = 0.01  # deviation of a traced point still on its surface, relative to depth


class Renderer:
    """
    Images of ``scene`` through the camera of a robot; equal inputs give equal bits.

    ``rig`` may be replaced by another with an equal camera, ``scene`` by one in another light.
    ``pose`` is the robot's, and ``frame`` that for which the rig is asked where the camera is. An
    ``assistant`` with the same scene may help, as long as it is not replaced.
    """

    def __init__(self, scene: Scene, rig: SimulatedRig) -> None:
        self.scene, self.camera, self.rig = scene, rig.camera, rig
        self._first = scene
        self.assistant: Assistant | None = None
        planar = rig.camera.planar
        self._drawing = Faces(rig.camera, lenses_of(rig)) if planar is None else _Canvas(planar)

    def render(self, pose: Pose, frame: int | None = None) -> Image:
        """Return the image taken from ``pose``, shape (H, W)."""
        assistant = self.assistant if self.scene is self._first else None
        return self._drawing.render(self.scene, self.rig.camera_pose(pose, frame), assistant)

    def project(
        self, points: FloatArray, pose: Pose, frame: int | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """
        Project world ``points`` [m], shape (N, 3), whether or not something hides them.

        Returns
        -------
        pixels : array, shape (N, 2)
            NaN for points that the lens does not see.
        visible : array of bool, shape (N,)
            Whether the lens sees the point, and in the image.

        """
        axes, centre = self.rig.camera_pose(pose, frame)
        vectors = (np.asarray(points, dtype=np.float64) - centre) @ axes
        pixels = np.full((len(vectors), 2), np.nan)
        planar = self.camera.planar
        if planar is None:
            far = np.sqrt((vectors * vectors).sum(axis=1)) > NEAR
            pixels[far] = self.camera.pixels(normalised(vectors[far]))
            return pixels, self.camera.contains(pixels)
        ahead = vectors[:, 2] > NEAR
        if ahead.any():
            pixels[ahead] = planar.pixels_of(vectors[ahead, :2] / vectors[ahead, 2:])
        return pixels, ahead & self.camera.contains(pixels)

    def trace(self, pixels: FloatArray, pose: Pose, frame: int | None = None) -> FloatArray:
        """
        Return the world points [m], shape (N, 3), seen at ``pixels``, shape (N, 2).

        They are NaN where there is no surface.
        """
        (axes, centre), scene = self.rig.camera_pose(pose, frame), self.scene
        directions = _vectors(self.camera, as_points(pixels, 'pixels')) @ axes.T
        origins = scene.corners[:, 0] - centre
        with np.errstate(divide='ignore', invalid='ignore'):
            depths = (origins * scene.normals).sum(axis=1) / (directions @ scene.normals.T)
            hits = depths[..., None] * directions[:, None] - origins
            inside = (depths > NEAR) & scene.facing(centre)
            for k in (1, 3):
                edge = scene.corners[:, k] - scene.corners[:, 0]
                share = (hits * edge).sum(axis=-1) / (edge**2).sum(axis=-1)
                inside &= (share >= 0.0) & (share <= 1.0)
        nearest = np.where(inside, depths, np.inf).min(axis=1)
        nearest[np.isinf(nearest)] = np.nan
        return np.asarray(centre + nearest[:, None] * directions)

    def unhidden(self, points: FloatArray, pixels: FloatArray, pose: Pose) -> BoolArray:
        """
        Return which points nothing in the scene hides, shape (N,), on a level floor.

        ``points`` [m], shape (N, 3), project to ``pixels``, shape (N, 2).
        """
        nearest = self.trace(pixels, pose)
        distance = np.linalg.norm(points - self.rig.camera_pose(pose).centre, axis=1)
        return np.asarray(np.linalg.norm(nearest - points, axis=1) <= SAME_PLACE * distance)


def _vectors(camera: CameraModel, pixels: FloatArray) -> FloatArray:
    """Return vectors along what ``pixels`` show, shape (N, 3): of a pinhole with z = 1."""
    if camera.planar is not None:
        return np.column_stack([camera.planar.image_points(pixels), np.ones(len(pixels))])
    return camera.rays(pixels)


class _Canvas:
    """The image of a pinhole, distorted after it is drawn."""

    def __init__(self, camera: PlanarCamera) -> None:
        self._size, self._intrinsics, self._maps = _canvas_of(camera)

    def render(self, scene: Scene, pose: CameraPose, assistant: Assistant | None = None) -> Image:
        """Return the image, shape (H, W)."""
        view = PinholeView(*self._size, self._intrinsics, pose.centre, pose.R_world_camera)
        image = draw(scene, view, assistant)
        if self._maps is None:
            return image
        # Cubic sampling would shift details by 0.03 px, Lanczos' by less than 0.01 px.
        distorted = cv2.remap(image, *self._maps, cv2.INTER_LANCZOS4)
        return np.asarray(distorted, dtype=np.uint8)


def _canvas_of(camera: PlanarCamera) -> tuple[tuple[int, int], FloatArray, tuple[Map, Map] | None]:
    """Return size and intrinsics of the pinhole image to draw, and the maps to distort it."""
    if not (camera.distorts or camera.skew):
        return (camera.width, camera.height), camera.matrix, None
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    rays = camera.image_points(np.stack([u.ravel(), v.ravel()], axis=1))
    # Black as well: where the distortion cannot be undone
    rays = np.nan_to_num(rays, nan=MAX_RAY, posinf=MAX_RAY, neginf=-MAX_RAY)
    ideal = np.clip(rays, -MAX_RAY, MAX_RAY) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    shift = 4.0 - np.floor(ideal.min(axis=0))  # the sampling reaches four pixels out
    width, height = (np.ceil(ideal.max(axis=0)) + shift + 5.0).astype(int).tolist()
    intrinsics = camera.matrix
    intrinsics[0, 1] = 0.0
    intrinsics[:2, 2] += shift
    maps = (ideal + shift).astype(np.float32).reshape(camera.height, camera.width, 2)
    return (width, height), intrinsics, (maps[..., 0].copy(), maps[..., 1].copy())
