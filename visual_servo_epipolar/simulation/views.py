"""Views of a run in memory: point features, or images through a tracker."""

from dataclasses import replace

from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.disturbances import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.point_world import PointWorld
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.view import View


def view_of(scenario: Scenario, source: str, seed: int) -> View:
    """Return what stands between world and servo; ``source`` is one of choices.SOURCES."""
    if source == 'features':
        return points_of(scenario, seed)
    simulator = CameraSimulator(scenario.camera, scenario.disturbances, scenario.light)
    return ImageView(simulator, Tracker(scenario.tracker, scenario.camera.nominal_camera))


def points_of(scenario: Scenario, seed: int) -> PointWorld:
    """Return the cloud of points of a run, seen by the scenario's camera."""
    camera, disturbances = scenario.camera, None
    if scenario.disturbances != DisturbanceSettings():
        size = camera.width, camera.height
        disturbances = Disturbances(size, scenario.disturbances, seed)
    return PointWorld(
        scenario.points,
        new_rig(replace(camera, seed=seed)),
        seed=seed,
        disturbances=disturbances,
        shutter=camera.row_timing,
    )
