"""The image of a scene through a camera, sub-pixel exact, and the truth behind each pixel."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_points, BoolArray, FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.rigs.rig import AT_REST, Joints
from visual_servo_epipolar.simulation.bases import Nod
from visual_servo_epipolar.simulation.rendering.raster import draw, MARGIN, NEAR, PinholeView
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rigs import exposed_from, SimulatedRig
from visual_servo_epipolar.simulation.sensor import CameraMotion, in_image, MAX_RAY, Shutter, STILL

SAME_PLACE = 0.01  # deviation of a traced point still on its surface, relative to depth
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

    size: tuple[int, int]
    intrinsics: FloatArray
    R_camera_face: FloatArray
    maps: tuple[FloatArray, FloatArray]
    box: tuple[int, int, int, int]  # left, top, width, height
    shown: Image  # which pixels of the box this face shows, as a mask


class Renderer:
    """
    Images of ``scene`` through the camera of a robot; equal inputs give equal bits.

    ``rig`` may be replaced by another with an equal camera, ``scene`` by one in another light.
    ``pose`` is the robot's, and ``frame`` that for which the rig is asked where the camera is:
    the floor is level for all but images.
    """

    def __init__(self, scene: Scene, rig: SimulatedRig) -> None:
        self.scene, self.camera, self.rig = scene, rig.camera, rig

    def render(
        self, pose: Pose, frame: int | None = None, motion: CameraMotion = STILL, time: float = 0.0
    ) -> Image:
        """
        Return the image taken ``time`` [s] after the robot was at ``pose``, shape (H, W).

        It is that of an instant of the ``motion``, and black where nothing is seen.
        """
        axes, centre = exposed_from(self.rig, pose, frame, motion, time)
        size, planar = (self.camera.width, self.camera.height), self.camera.planar
        if planar is not None and not (planar.distorts or planar.skew):
            return draw(self.scene, PinholeView(*size, planar.matrix, centre, axes))
        image: Image = np.zeros(size[::-1], dtype=np.uint8)
        for face in self._faces:
            view = PinholeView(*face.size, face.intrinsics, centre, axes @ face.R_camera_face)
            # Cubic sampling would shift details by 0.03 px, Lanczos' by less than 0.01 px.
            part = cv2.remap(draw(self.scene, view), *face.maps, cv2.INTER_LANCZOS4)
            left, top, width, height = face.box
            cv2.copyTo(part, face.shown, image[top : top + height, left : left + width])
        return image

    @cached_property
    def _faces(self) -> list[Face]:
        return list(_faces(self.camera))

    def project(
        self, points: FloatArray, pose: Pose, frame: int | None = None, joints: Joints = AT_REST
    ) -> tuple[FloatArray, BoolArray]:
        """
        Project world ``points`` [m], shape (N, 3), whether or not something hides them.

        Returns pixels, shape (N, 2), and which points the lens sees within the image, shape (N,).
        """
        axes, centre = self.rig.camera_pose(pose, frame, joints)
        return in_image((np.asarray(points, dtype=np.float64) - centre) @ axes, self.camera)

    def trace(self, pixels: FloatArray, pose: Pose, joints: Joints = AT_REST) -> FloatArray:
        """
        Return the world points [m], shape (N, 3), seen at ``pixels``, shape (N, 2).

        They are NaN where there is no surface.
        """
        (axes, centre), scene = self.rig.camera_pose(pose, None, joints), self.scene
        pixels, planar = as_points(pixels, 'pixels'), self.camera.planar
        if planar is None:
            vectors = self.camera.rays(pixels)
        else:
            vectors = np.column_stack([planar.image_points(pixels), np.ones(len(pixels))])
        directions = vectors @ axes.T
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

    def unhidden(
        self, points: FloatArray, pixels: FloatArray, pose: Pose, joints: Joints = AT_REST
    ) -> BoolArray:
        """
        Return which points nothing in the scene hides, shape (N,), on a level floor.

        ``points`` [m], shape (N, 3), project to ``pixels``, shape (N, 2).
        """
        nearest = self.trace(pixels, pose, joints)
        distance = np.linalg.norm(points - self.rig.camera_pose(pose).centre, axis=1)
        return np.asarray(np.linalg.norm(nearest - points, axis=1) <= SAME_PLACE * distance)


def rays_of(camera: CameraModel, zoom: float = 1.0) -> FloatArray:
    """
    Return a ray for each pixel, shape (H, W, 3), (x/z, y/z, 1) of a pinhole.

    ``zoom`` magnifies the image about the principal point.
    """
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    centre = np.array([camera.cx, camera.cy])
    pixels = (np.stack([u.ravel(), v.ravel()], axis=1) - centre) / zoom + centre
    if camera.planar is None:
        rays = camera.rays(pixels)
    else:
        points = np.nan_to_num(camera.planar.image_points(pixels), nan=MAX_RAY)
        points = np.clip(points, -MAX_RAY, MAX_RAY)
        rays = np.column_stack([points, np.ones(len(points))])
    return rays.reshape(camera.height, camera.width, 3)


def _faces(camera: CameraModel) -> Iterator[Face]:
    """Yield the pinhole image that a lens distorts, or the faces of a cube around a wider one."""
    rays = rays_of(camera)
    nearest = np.zeros((camera.height, camera.width), int)
    axes = [np.array(columns).T for columns in AXES.values()]
    if camera.planar is None:
        seen = np.isfinite(rays).all(axis=2)
        ahead = np.array([each[:, 2] for each in axes])
        nearest[seen] = np.argmax(rays[seen] @ ahead.T, axis=1)
        nearest[~seen] = -1
    for k, each in enumerate(axes):
        part = nearest == k
        if part.any():
            yield _face(camera, rays, part, each)


def _face(camera: CameraModel, rays: FloatArray, shown: FloatArray, axes: FloatArray) -> Face:
    """Return the face with ``axes`` that is large enough for the pixels ``shown``, (H, W)."""
    mask: Image = shown.astype(np.uint8) * 255
    left, top, width, height = cv2.boundingRect(mask)
    part = slice(top, top + height), slice(left, left + width)
    directions = rays[part] @ axes
    ahead = np.where(shown[part][..., None], directions, [0.0, 0.0, 1.0])
    ideal = ahead[..., :2] / ahead[..., 2:] * [camera.fx, camera.fy]
    ends = ideal[shown[part]]
    border = MARGIN + 1.0  # the sampling reaches four pixels out
    origin = np.floor(ends.min(axis=0)) - border
    size = (np.ceil(ends.max(axis=0)) - origin + border + 1.0).astype(int).tolist()
    cx, cy = (-origin).tolist()
    intrinsics = np.array([[camera.fx, 0.0, cx], [0.0, camera.fy, cy], [0.0, 0.0, 1.0]])
    u, v = cv2.split((ideal - origin).astype(np.float32))
    box = left, top, width, height
    return Face((size[0], size[1]), intrinsics, axes, (u, v), box, mask[part].copy())


NEAREST_M = 2.0  # distance at which one pixel of blur takes one sample


class Exposures:
    """
    Images of a camera in motion, put together of such as ``renderer`` draws in an instant.

    One is drawn each few millimetres of the way. From there on the turn alone moves each row,
    which is exact at any depth.
    """

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._ideal: Renderer | None = None  # without distortion, and wider
        self._rays: tuple[float, FloatArray] | None = None  # by the zoom

    def render(self, pose: Pose, frame: int, motion: CameraMotion, shutter: Shutter) -> Image:
        """Return the image, shape (H, W), of ``frame``, whose first row is exposed at ``pose``."""
        (twist, nod, joints), camera = motion, self._renderer.camera
        zoom = shutter.zoom(frame)
        if zoom == 1.0 and (shutter.is_instant or (twist == STANDSTILL and nod.rate == 0.0)):
            return self._renderer.render(pose, frame, motion)
        rays = self._rays_at(zoom)
        renderer = self._source()
        samples = _samples(twist, nod, shutter.exposure, camera)
        opened = shutter.exposure * ((np.arange(samples) + 0.5) / samples - 0.5)
        times = opened[:, None] + np.arange(camera.height) / camera.height * shutter.readout
        first, last = float(times.min()), float(times.max())
        count = 1 + math.floor(abs(twist.linear) * (last - first) / 2e-3)  # [m] apart
        middles = first + (np.arange(count) + 0.5) / count * (last - first)
        nearest = np.abs(times[..., None] - middles).argmin(axis=2)
        axes = renderer.rig.camera_pose(pose, frame, joints).R_world_camera
        left = np.array([-math.sin(pose.theta), math.cos(pose.theta), 0.0])
        turn = (twist.angular * np.array([0.0, 0.0, 1.0]) + nod.rate * left) @ axes
        flags = cv2.INTER_LANCZOS4 if samples == 1 else cv2.INTER_LINEAR
        total = np.zeros((camera.height, camera.width), np.float32)
        for number, middle in enumerate(middles.tolist()):
            drawn = renderer.render(pose, frame, motion, middle)
            for sample in range(samples):
                rows = np.flatnonzero(nearest[sample] == number)
                if len(rows):
                    part = slice(rows[0], rows[-1] + 1)
                    since = times[sample, part] - middle
                    maps = _maps(renderer.camera, _turned(rays[part], since, turn))
                    total[part] += cv2.remap(drawn, *maps, flags, None, cv2.BORDER_REPLICATE)
        return np.asarray(cv2.convertScaleAbs(total, alpha=1.0 / samples), np.uint8)

    def _rays_at(self, zoom: float) -> FloatArray:
        """Return a ray for each pixel, shape (H, W, 3); those of the last zoom are kept."""
        if self._rays is None or self._rays[0] != zoom:
            self._rays = zoom, rays_of(self._renderer.camera, zoom)
        return self._rays[1]

    def _source(self) -> Renderer:
        """Return what draws in an instant: of a pinhole one without distortion that sees more."""
        original, camera = self._renderer, self._renderer.camera
        if camera.planar is None:
            return original
        rig: Any = original.rig
        if self._ideal is None:
            border = math.ceil(0.06 * camera.width)  # what a turn brings in
            points = self._rays_at(1.0)[..., :2].reshape(-1, 2) * [camera.fx, camera.fy]
            low = np.floor(points.min(axis=0)) - border
            width, height = (np.ceil(points.max(axis=0)) + border - low + 1.0).astype(int).tolist()
            cx, cy = (-low).tolist()
            ideal = Camera(width, height, camera.fx, camera.fy, cx, cy)
            self._ideal = Renderer(original.scene, replace(rig, camera=ideal))
        self._ideal.scene = original.scene
        self._ideal.rig = replace(rig, camera=self._ideal.camera)
        return self._ideal


def _samples(twist: Twist, nod: Nod, exposure: float, camera: CameraModel) -> int:
    """Return how many instants make up one exposure: about one a pixel of blur."""
    moved = math.hypot(twist.angular, nod.rate) + abs(twist.linear) / NEAREST_M
    return min(max(math.ceil(camera.focal * exposure * moved), 1), 32)  # of one exposure


def _turned(rays: FloatArray, times: FloatArray, turn: FloatArray) -> FloatArray:
    """Return ``rays``, (H, W, 3), of each row after its time, (H,) [s], at a ``turn`` [rad/s]."""
    rate = math.hypot(*turn.tolist())
    axis, turns = turn / max(rate, 1e-12), rate * times
    sine, cosine = np.sin(turns)[:, None, None], np.cos(turns)[:, None, None]
    along = (rays @ axis)[..., None] * axis
    return np.asarray(cosine * (rays - along) + along + sine * np.cross(axis, rays))


def _maps(camera: CameraModel, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where ``rays``, shape (H, W, 3), are in the image of ``camera``, as for cv2.remap."""
    if camera.planar is None:
        pixels = camera.pixels(rays.reshape(-1, 3)).reshape(*rays.shape[:2], 2)
        u, v = np.nan_to_num(pixels[..., 0], nan=-1.0), np.nan_to_num(pixels[..., 1], nan=-1.0)
    else:
        u = camera.fx * rays[..., 0] / rays[..., 2] + camera.cx
        v = camera.fy * rays[..., 1] / rays[..., 2] + camera.cy
    return u.astype(np.float32), v.astype(np.float32)
