"""Wide lenses: the tracker takes on the features that a turn brings into view."""

import math

import numpy as np

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.perception.measures import view_margins
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

SIDE, KEPT = 600, 12  # [px]; features that a turn must leave in view
CAMERA = CameraSettings(
    scene_seed=101,
    width=SIDE,
    height=SIDE,
    focal_length=SIDE / math.radians(195.0),
    principal_u=0.5 * (SIDE - 1),
    principal_v=0.5 * (SIDE - 1),
    distortion_model='equidistant',
    image_circle=195.0,
)


def test_a_turn_through_half_a_circle_is_free_all_the_way() -> None:
    """It stayed with the features that it began with, which came to one edge, and barred it."""
    simulator, camera = CameraSimulator(CAMERA), CAMERA.nominal_camera
    tracker, free = Tracker(TrackerSettings(), camera), []
    tracker.set_desired(simulator.photograph())
    for frame in range(40):
        pose = Pose.from_start(-3.2, 0.6, -142.0 + 3.9 * frame)
        rays = camera.rays(tracker.track(simulator.capture(pose, frame)).current)
        left, _ = view_margins(rays, np.ones(len(rays), bool), camera.edges, KEPT)
        free.append(left)
    assert min(free) > 1.0
