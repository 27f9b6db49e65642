"""
What the tracker costs on small images with few features, for docs/results.md.

Processor time of a frame on one thread, and the error against ground truth, on rendered approaches
of the tracking benchmark. Usage: python small_computer.py
"""

from dataclasses import replace
from time import process_time
from typing import TypeAlias

import cv2
import numpy as np

from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.benchmarks.tracking import (
    approach,
    QUICK,
    start_of,
    TrueFeatures,
)
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator

SCENES, FRAMES, STANDING = (101, 102, 103), 100, 5
SIZES, FEATURES = ((320, 240), (640, 480)), (30, 60)
Rows: TypeAlias = dict[int, tuple[list[float], list[float], list[float]]]  # times, errors


def main() -> None:
    """Print one row for each size of the image and number of features."""
    cv2.setNumThreads(1)
    print('| images | features | ms a frame, median / p95 | px on the way / at the goal |')
    print('|---|---|---|---|')
    for size in SIZES:
        rows: Rows = {count: ([], [], []) for count in FEATURES}
        for scene in SCENES:
            _approach(size, scene, rows)
        for count, (seconds, route, goal) in rows.items():
            median, high = 1e3 * np.percentile(seconds, (50, 95))
            print(
                f'| {size[0]}x{size[1]} | {count} | {median:.1f} / {high:.1f} | '
                f'{np.median(route):.3f} / {np.median(goal):.3f} |'
            )


def _approach(size: tuple[int, int], scene: int, rows: Rows) -> None:
    """Track one approach with each number of features, and add times [s] and errors [px]."""
    share = size[0] / QUICK.camera.width
    centre = 0.5 * (size[0] - 1), 0.5 * (size[1] - 1)
    camera = replace(
        QUICK.camera,
        width=size[0],
        height=size[1],
        focal_length=share * QUICK.camera.focal_length,
        principal_u=centre[0],
        principal_v=centre[1],
        scene_seed=scene,
        seed=scene,
    )
    world = CameraSimulator(camera)
    truth = TrueFeatures(world.renderer)
    trackers = {}
    for count in rows:
        trackers[count] = Tracker(TrackerSettings(max_features=count, min_features=2 * count // 3))
        trackers[count].set_desired(world.photograph())
    for frame, pose in enumerate(approach(start_of(scene, FRAMES), FRAMES)):
        image = world.capture(pose, frame)
        for count, (seconds, route, goal) in rows.items():
            began, matchings = process_time(), trackers[count].matchings
            features = trackers[count].track(image)
            if trackers[count].matchings == matchings:
                seconds.append(process_time() - began)
            errors = truth.errors(features, pose)
            kept = goal if frame >= FRAMES - STANDING else route
            kept += errors.distances[errors.trackable].tolist()


if __name__ == '__main__':
    main()
