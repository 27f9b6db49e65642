"""What the servo sees in a run in memory: point features, or images through a tracker."""

from visual_servo_epipolar.core.tracking import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import View
from visual_servo_epipolar.simulation.point_world import PointWorld
from visual_servo_epipolar.simulation.scenario import Scenario

SOURCES = ('features', 'images')


def view_of(scenario: Scenario, source: str, seed: int) -> View:
    """Return what stands between world and servo; ``source`` is one of ``SOURCES``."""
    if source == 'features':
        return PointWorld(scenario.points, scenario.camera.camera, seed=seed)
    return ImageView(CameraSimulator(scenario.camera), Tracker(scenario.tracker))
