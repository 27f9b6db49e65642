"""Images through a shutter that is no instant: rows read out one by one, blurred by the motion."""

from dataclasses import replace
import math
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.simulation.mounts.shutter import Shutter
from visual_servo_epipolar.simulation.nod import LEVEL, Nod
from visual_servo_epipolar.simulation.rendering.renderer import MAX_RAY, Renderer

BORDER = 0.06  # of the width: what a turn during the readout brings into the image
STEP_M = 2e-3  # way from one image that is drawn to the next
MOST_SAMPLES = 32  # of one exposure
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

    def render(
        self, pose: Pose, frame: int, twist: Twist, shutter: Shutter, nod: Nod = LEVEL
    ) -> Image:
        """Return the image, shape (H, W), of ``frame``, whose first row is exposed at ``pose``."""
        zoom, camera = shutter.zoom(frame), self._renderer.camera
        self._renderer.pitch = nod.pitch
        if zoom == 1.0 and (shutter.is_instant or (twist == STANDSTILL and nod.rate == 0.0)):
            return self._renderer.render(pose, frame)
        rays = self._rays_at(zoom)
        renderer = self._source()
        samples = _samples(twist, nod, shutter.exposure, camera)
        opened = shutter.exposure * ((np.arange(samples) + 0.5) / samples - 0.5)
        times = opened[:, None] + np.arange(camera.height) / camera.height * shutter.readout
        first, last = float(times.min()), float(times.max())
        count = 1 + math.floor(abs(twist.linear) * (last - first) / STEP_M)
        middles = first + (np.arange(count) + 0.5) / count * (last - first)
        nearest = np.abs(times[..., None] - middles).argmin(axis=2)
        axes = renderer.rig.camera_pose(pose, frame).R_world_camera
        left = np.array([-math.sin(pose.theta), math.cos(pose.theta), 0.0])
        turn = (twist.angular * np.array([0.0, 0.0, 1.0]) + nod.rate * left) @ axes
        flags = cv2.INTER_LANCZOS4 if samples == 1 else cv2.INTER_LINEAR
        total = np.zeros((camera.height, camera.width), np.float32)
        for number, middle in enumerate(middles.tolist()):
            renderer.pitch = nod.pitch + nod.rate * middle
            drawn = renderer.render(integrate(pose, twist, middle), frame)
            for sample in range(samples):
                rows = np.flatnonzero(nearest[sample] == number)
                if len(rows):
                    part = slice(rows[0], rows[-1] + 1)
                    since = times[sample, part] - middle
                    maps = _maps(renderer.camera, _turned(rays[part], since, turn))
                    total[part] += cv2.remap(drawn, *maps, flags, None, cv2.BORDER_REPLICATE)
        return np.asarray(cv2.convertScaleAbs(total, alpha=1.0 / samples), np.uint8)

    def _rays_at(self, zoom: float) -> FloatArray:
        """Return a ray for each pixel, shape (H, W, 3), (x/z, y/z, 1) of a pinhole."""
        if self._rays is None or self._rays[0] != zoom:
            camera = self._renderer.camera
            u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
            centre = np.array([camera.cx, camera.cy])
            pixels = (np.stack([u.ravel(), v.ravel()], axis=1) - centre) / zoom + centre
            if camera.planar is None:
                rays = camera.rays(pixels)
            else:
                points = np.nan_to_num(camera.planar.image_points(pixels), nan=MAX_RAY)
                points = np.clip(points, -MAX_RAY, MAX_RAY)
                rays = np.column_stack([points, np.ones(len(points))])
            self._rays = zoom, rays.reshape(camera.height, camera.width, 3)
        return self._rays[1]

    def _source(self) -> Renderer:
        """Return what draws in an instant: of a pinhole one without distortion that sees more."""
        original, camera = self._renderer, self._renderer.camera
        if camera.planar is None:
            return original
        rig: Any = original.rig
        if self._ideal is None:
            border = math.ceil(BORDER * camera.width)
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
    return min(max(math.ceil(camera.focal * exposure * moved), 1), MOST_SAMPLES)


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
