"""
Time of the camera simulator per image, beside one full-frame remap of OpenCV in the same run.

It is the processor's time on one thread: what else the machine does meanwhile counts only where
it shares caches. The remap is bilinear, from two float maps: the last step of any renderer.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from time import process_time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.evaluation.benchmarks.tracking.world import approach, start_of
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.rendering.edges import mixing, smooth_edges
from visual_servo_epipolar.simulation.rendering.raster import PinholeView, Raster, rasterize
from visual_servo_epipolar.simulation.rendering.sampling import draw_textures
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

LARGE = CameraSettings(noise=2.0)
SMALL = replace(
    LARGE, width=640, height=480, focal_length=384.6, principal_u=317.25, principal_v=239.75
)
TURN = 0.05  # of the remapped image [rad]


@dataclass(frozen=True, slots=True)
class RenderingPlan:
    """Cameras, and how many images along one approach of 200 each takes."""

    cameras: Sequence[CameraSettings] = (LARGE, SMALL)
    images: int = 100


QUICK = RenderingPlan(cameras=(SMALL,), images=6)


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document of the benchmark; ``say`` is told the progress."""
    return measure(QUICK if quick else RenderingPlan(), seed, say)


def measure(plan: RenderingPlan, seed: int, say: Callable[[str], None]) -> dict[str, Any]:
    """Carry out ``plan``."""
    poses = approach(start_of(seed, 200), 200)
    poses = [poses[k] for k in np.linspace(0, len(poses) - 1, plan.images).astype(int)]
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        rows = [_camera(settings, poses, seed, say) for settings in plan.cameras]
    finally:
        cv2.setNumThreads(threads)
    return {'seed': seed, 'images': plan.images, 'opencv': cv2.__version__, 'cameras': rows}


def _camera(
    settings: CameraSettings, poses: Sequence[Pose], seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    size = settings.width, settings.height
    say(f'{size[0]}x{size[1]}: first images')
    simulator = CameraSimulator(replace(settings, seed=seed))
    for pose in poses:  # textures are blurred and reduced when they are first asked for
        simulator.capture(pose, 0)
    maps = turning_maps(size, TURN)
    seconds = []
    for frame, pose in enumerate(poses):
        say(f'{size[0]}x{size[1]}: image {frame + 1} of {len(poses)}')
        image, whole = time_of(simulator.capture, pose, frame)
        _, bare = time_of(cv2.remap, image, *maps, cv2.INTER_LINEAR)
        seconds.append({'image': whole, 'remap': bare, **stage_times(simulator, pose, frame)})
    milliseconds = {name: [1e3 * row[name] for row in seconds] for name in seconds[0]}
    figures = {name: spread(values) for name, values in milliseconds.items()}
    return {
        'size': list(size),
        'ms': figures,
        'ratio': spread((np.array(milliseconds['image']) / milliseconds['remap']).tolist()),
    }


def stage_times(simulator: CameraSimulator, pose: Pose, frame: int) -> dict[str, float]:
    """Return what each stage of an image takes [s], of a camera without distortion."""
    renderer = simulator.renderer
    scene, camera = renderer.scene, simulator.settings
    R_world_camera, centre = renderer.rig.camera_pose(pose, frame)
    intrinsics = camera.camera.matrix
    view = PinholeView(camera.width, camera.height, intrinsics, centre, R_world_camera)
    raster, polygons = time_of(rasterize, scene, view)
    image: Image = np.zeros((camera.height, camera.width), np.uint8)
    _, textures = time_of(draw_textures, scene, raster, image)
    _, edges = time_of(mix_edges, image, scene, view, raster)
    return {'polygons': polygons, 'textures': textures, 'edges': edges}


def mix_edges(image: Image, scene: Scene, view: PinholeView, raster: Raster) -> None:
    """Smooth the edges of ``image``, shape (H, W)."""
    smooth_edges(image, mixing(scene, view, raster))


def time_of(work: Callable[..., Any], *given: Any) -> tuple[Any, float]:
    """Return what ``work`` returns for what is ``given``, and its time [s]: the processor's."""
    began = process_time()
    result = work(*given)
    return result, process_time() - began


def turning_maps(size: tuple[int, int], angle: float) -> tuple[FloatArray, FloatArray]:
    """Return maps, float32 of shape (H, W), that turn an image of ``size`` by ``angle`` [rad]."""
    width, height = size
    u, v = np.meshgrid(np.arange(width) - 0.5 * width, np.arange(height) - 0.5 * height)
    sin, cos = math.sin(angle), math.cos(angle)
    x, y = cos * u - sin * v + 0.5 * width, sin * u + cos * v + 0.5 * height
    return x.astype(np.float32), y.astype(np.float32)


def spread(values: Sequence[float]) -> dict[str, float]:
    """Return median and quartiles."""
    low, median, high = np.percentile(values, (25.0, 50.0, 75.0)).tolist()
    return {'median': median, 'low': low, 'high': high}


STAGES = ('image', 'polygons', 'textures', 'edges', 'remap')


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: a row a camera."""
    sizes = {f'{"x".join(map(str, it["size"]))}': it for it in document['cameras']}
    lines = aligned(
        ' | '.join(('size', *STAGES, 'image / remap')),
        (
            [size, *(_spread(it['ms'][stage], 1) for stage in STAGES), _spread(it['ratio'], 2)]
            for size, it in sizes.items()
        ),
    )
    words = (
        f'Rendering, {document["images"]} images along an approach, processor time on one thread '
        f'[ms]: median (quartiles), OpenCV {document["opencv"]}'
    )
    return '\n'.join([words, *lines])


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    return {
        f'{"x".join(map(str, camera["size"]))} image over remap': camera['ratio']['median']
        for camera in document['cameras']
    }


def _spread(of: Mapping[str, float], digits: int) -> str:
    median, low, high = (f'{of[name]:.{digits}f}' for name in ('median', 'low', 'high'))
    return f'{median} ({low}-{high})'
