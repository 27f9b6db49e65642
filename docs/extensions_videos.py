"""
Films a run of each rig in images, for docs/extensions.md: docs/extensions_RIG.webp.

`python docs/extensions_videos.py [RIG ...]`: what the camera sees with the features tracked in it,
beside the map; faster than the robot drives.
"""

from dataclasses import replace
from pathlib import Path
import sys

import cv2
import numpy as np
from PIL import Image as Pictures

from visual_servo_epipolar.commands.arguments import rig_path
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.report.images.map_view import MapView
from visual_servo_epipolar.report.images.video import HEIGHT, picture
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.scenario import load, Scenario

# Where each begins, and how high its images are [px].
RIGS = {
    'panorama': ((1.2, 0.5, -140.0), 480),
    'fisheye': ((1.0, 0.6, 40.0), 640),
    'pan': ((1.2, -0.6, 30.0), 512),
    'car': ((0.7, -0.6, 10.0), 512),
}
ROWS, QUALITY = 240, 30  # of the film [px]
EVERY, MOST = 4, 40  # frames of the run to one of the film, and frames of the film
FRAME_MS = 90
SEED = 0


def small(rig: str, rows: int) -> Scenario:
    """Return the scenario of a rig with images so high."""
    scenario = load(None, rig_path(rig)).seeded(SEED)
    camera = scenario.camera
    ratio = rows / camera.height
    camera = replace(
        camera,
        width=round(ratio * camera.width),
        height=rows,
        focal_length=ratio * camera.focal_length,
        principal_u=ratio * (camera.principal_u + 0.5) - 0.5,
        principal_v=ratio * (camera.principal_v + 0.5) - 0.5,
    )
    return replace(scenario, camera=camera)


def film(rig: str) -> list[Image]:
    """Return the frames of a run, in colour."""
    start, rows = RIGS[rig]
    scenario = small(rig, rows)
    camera = scenario.camera.nominal_camera
    view = ImageView(CameraSimulator(scenario.camera), Tracker(scenario.tracker, camera))
    settings = scenario.loop(start, SEED)
    loop = Loop(settings, view, camera)
    plane = MapView(Pose.from_start(*start), HEIGHT, settings.field_of_view or 0.0)
    frames = []

    def watch(sample: Sample) -> None:
        plane.add(sample)
        if loop.driven.frame % EVERY == 1:
            if settings.head is not None:  # bearings are in axes of the base, not of the image
                sample = replace(sample, bearing_current=np.nan)
            seen = picture(view.image, view.features, sample, camera)
            frames.append(_beside(seen, plane.picture()))

    log = loop.run(watch=watch)
    print(f'{rig}: {log.outcome}, {loop.driven.frame} images')
    return frames[:: 1 + len(frames) // MOST]


def _beside(seen: Image, plane: Image) -> Image:
    parts = [
        cv2.resize(each, (round(ROWS * each.shape[1] / each.shape[0]), ROWS), interpolation=3)
        for each in (seen, plane)
    ]
    return np.asarray(cv2.cvtColor(np.hstack(parts), cv2.COLOR_BGR2RGB), np.uint8)


def main(rigs: list[str], folder: Path = Path(__file__).parent) -> None:
    """Write the films of ``rigs``."""
    for rig in rigs:
        first, *rest = [Pictures.fromarray(frame) for frame in film(rig)]
        first.save(
            folder / f'extensions_{rig}.webp',
            save_all=True,
            append_images=rest,
            duration=FRAME_MS,
            loop=0,
            quality=QUALITY,
            method=4,
        )


if __name__ == '__main__':
    main(sys.argv[1:] or list(RIGS))
