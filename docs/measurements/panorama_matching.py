"""
Prints how many SIFT matches of panoramas are right: on the image as it is, on a cylinder, a cube.

`python docs/measurements/panorama_matching.py [POSES]`: pairs of a photograph of 960x480 and an
image from a start of region around, in the room; right is within 4 px of the truth. About 2 s of
processor a pose.
"""

from collections.abc import Callable
import sys

import cv2
import numpy as np

from visual_servo_epipolar.commands.arguments import rig_path
from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.core.tracking.matchers.base import mutual_nearest
from visual_servo_epipolar.core.tracking.matchers.sift import detect
from visual_servo_epipolar.core.tracking.robust_geometry import epipolar_geometry
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.rendering.renderer import AXES
from visual_servo_epipolar.simulation.scenario import load

SCENARIO = load(None, rig_path('panorama_small'))
CAMERA = SCENARIO.camera.nominal_camera
FACE, STEEPEST, LIMIT = 380, 60.0, 4000  # side of a face of 100 deg [px], of a cylinder [deg]
RIGHT_PX = 4.0
Keypoints = tuple[FloatArray, FloatArray]  # rays, (N, 3), and descriptors, (N, 128)


def as_it_is(image: Image) -> Keypoints:
    """Return the keypoints of the image, and of what goes on beyond its seam and poles."""
    canvas = Canvas.of(CAMERA)
    found = detect(canvas.painted(image), limit=LIMIT)
    found = found.take(canvas.owns(found.pixels))
    return canvas.points(found.pixels), found.descriptors


def on_a_cylinder(image: Image) -> Keypoints:
    """Return those of the image on a cylinder: rows by the tangent of the elevation."""
    half = round(CAMERA.focal * np.tan(np.radians(STEEPEST)))
    u, down = np.meshgrid(np.arange(CAMERA.width) + 0.0, np.arange(-half, half + 1.0))
    bearing = (u - CAMERA.cx) / CAMERA.fx
    rays = np.stack([np.sin(bearing), down / CAMERA.focal, np.cos(bearing)], axis=-1)
    return _on(image, rays)


def on_a_cube(image: Image) -> Keypoints:
    """Return those of six faces of a cube, of 100 deg each, those that are nearest to a face."""
    scale = np.tan(np.radians(50.0)) * np.linspace(-1.0, 1.0, FACE)
    u, v = np.meshgrid(scale, scale)
    parts = []
    for axes in AXES.values():
        rays, descriptors = _on(image, np.stack([u, v, np.ones_like(u)], axis=-1) @ np.array(axes))
        own = rays @ np.array(axes[2]) >= np.abs(rays).max(axis=1) - 1e-9
        parts.append((rays[own], descriptors[own]))
    rays, descriptors = (np.concatenate(each) for each in zip(*parts, strict=True))
    return rays, descriptors


def _on(image: Image, rays: FloatArray) -> Keypoints:
    """Return the keypoints of what is seen at ``rays``, (H, W, 3), as unit rays."""
    unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    maps = CAMERA.pixels(unit.reshape(-1, 3)).astype(np.float32).reshape(*rays.shape[:2], 2)
    seen = cv2.remap(image, maps, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    found = detect(np.asarray(seen, np.uint8), limit=LIMIT)
    at = cv2.remap(
        unit.astype(np.float32), found.pixels.astype(np.float32)[:, None], None, cv2.INTER_LINEAR
    )
    at = at[:, 0].astype(np.float64)
    return at / np.linalg.norm(at, axis=1, keepdims=True), found.descriptors


def right(
    current: Keypoints, desired: Keypoints, truth: Callable[[FloatArray], FloatArray]
) -> int:
    """Return how many matches that agree on one geometry are within RIGHT_PX of the ``truth``."""
    pairs = mutual_nearest(desired[1], current[1])
    before, after = desired[0][pairs[:, 0]], current[0][pairs[:, 1]]
    inliers = epipolar_geometry(after, before, 1.0 / CAMERA.focal)[1]
    apart = np.linalg.norm(truth(before[inliers]) - after[inliers], axis=1)
    return int((apart * CAMERA.focal <= RIGHT_PX).sum())


def main(poses: int = 12) -> None:
    """Print the median and the least of right matches by kind of image."""
    simulator = CameraSimulator(SCENARIO.camera)
    photograph, renderer = simulator.photograph(), simulator.renderer
    kinds = (as_it_is, on_a_cylinder, on_a_cube)
    desired = [kind(photograph) for kind in kinds]
    counts = []
    for k in range(poses):
        pose = Pose.from_start(*start_in('around', 3, k, SCENARIO, source='images'))
        image = simulator.capture(pose, k)

        def truth(rays: FloatArray, pose: Pose = pose) -> FloatArray:
            points = renderer.trace(CAMERA.pixels(rays), DESIRED_POSE)
            return CAMERA.rays(renderer.project(points, pose)[0])

        counts.append(
            [right(kind(image), own, truth) for kind, own in zip(kinds, desired, strict=True)]
        )
    for kind, column in zip(kinds, np.array(counts).T, strict=True):
        print(f'{kind.__name__:15s} median {np.median(column):.0f}, least {column.min()}')


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
