"""Faces of a cube around a camera: pinhole images that make up that of a lens wider than any."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.simulation.mounts.simulated_rig import (
    CameraPose,
    LensPlacement,
    ONE_LENS,
)
from visual_servo_epipolar.simulation.rendering.assistant import Assistant, draw
from visual_servo_epipolar.simulation.rendering.raster import PinholeView
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

BORDER = 5.0  # beyond what is shown: the sampling reaches four pixels out [px]
# Axes right, down, forward of each face in those of the camera, as columns.
AXES = {
    'ahead': ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    'right': ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
    'left': ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
    'below': ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
    'above': ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    'behind': ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
}


class Face(NamedTuple):
    """One pinhole image, and where in it the pixels of a box of the lens's image are."""

    R_camera_face: FloatArray
    size: tuple[int, int]
    intrinsics: FloatArray
    box: tuple[int, int, int, int]  # left, top, width, height
    maps: tuple[FloatArray, FloatArray]
    shown: Image  # which pixels of the box this face shows, as a mask


class Faces:
    """The image of a camera that is no pinhole, from as many faces of a cube as it sees."""

    def __init__(self, camera: CameraModel, lenses: Sequence[LensPlacement] = ONE_LENS) -> None:
        self._camera = camera
        u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
        rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
        rays = rays.reshape(camera.height, camera.width, 3)
        nearest = np.full((camera.height, camera.width), -1)
        seen = np.isfinite(rays).all(axis=2)
        axes = [np.array(columns).T for columns in AXES.values()]
        nearest[seen] = np.argmax(rays[seen] @ np.array([each[:, 2] for each in axes]).T, axis=1)
        self._faces = [
            (_face(camera, rays, part, each), lens)
            for lens in lenses
            for k, each in enumerate(axes)
            if (part := (nearest == k) & lens.shows(rays)).any()
        ]

    def render(self, scene: Scene, pose: CameraPose, assistant: Assistant | None = None) -> Image:
        """Return the image, shape (H, W); black where the lens sees nothing."""
        image: Image = np.zeros((self._camera.height, self._camera.width), dtype=np.uint8)
        for face, lens in self._faces:
            axes, centre = pose if lens is ONE_LENS[0] else lens.pose(pose)
            view = PinholeView(*face.size, face.intrinsics, centre, axes @ face.R_camera_face)
            ideal = draw(scene, view, assistant)
            part = cv2.remap(ideal, *face.maps, cv2.INTER_LANCZOS4)
            left, top, width, height = face.box
            cv2.copyTo(part, face.shown, image[top : top + height, left : left + width])
        return image


def _face(camera: CameraModel, rays: FloatArray, shown: FloatArray, axes: FloatArray) -> Face:
    """Return the face with ``axes`` that is large enough for the pixels ``shown``, (H, W)."""
    mask: Image = shown.astype(np.uint8) * 255
    left, top, width, height = cv2.boundingRect(mask)
    part = slice(top, top + height), slice(left, left + width)
    directions = rays[part] @ axes
    inside = shown[part]
    ahead = np.where(inside[..., None], directions, [0.0, 0.0, 1.0])
    ideal = ahead[..., :2] / ahead[..., 2:] * [camera.fx, camera.fy]
    ends = ideal[inside]
    origin = np.floor(ends.min(axis=0)) - BORDER
    size = (np.ceil(ends.max(axis=0)) - origin + BORDER + 1.0).astype(int).tolist()
    cx, cy = (-origin).tolist()
    intrinsics = np.array([[camera.fx, 0.0, cx], [0.0, camera.fy, cy], [0.0, 0.0, 1.0]])
    maps = (ideal - origin).astype(np.float32)
    return Face(
        axes,
        (size[0], size[1]),
        intrinsics,
        (left, top, width, height),
        (maps[..., 0].copy(), maps[..., 1].copy()),
        np.ascontiguousarray(mask[part]),
    )
