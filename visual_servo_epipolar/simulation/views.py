"""A run in memory by a scenario: its view, point features or images, and the one loop."""

from collections.abc import Callable
from dataclasses import replace

from visual_servo_epipolar.core.servo.run_log import RunLog, Sample
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.choices import refuse_unknown, SOURCES
from visual_servo_epipolar.simulation.closed_loop import Control, Loop, View
from visual_servo_epipolar.simulation.disturbances import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.point_world import PointWorld
from visual_servo_epipolar.simulation.scenario import Scenario


def view_of(scenario: Scenario, source: str, seed: int) -> View:
    """Return what stands between world and servo; InputError for a ``source`` that is none."""
    refuse_unknown('source', source, SOURCES)
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
        replace(camera, seed=seed).rig(),
        seed=seed,
        disturbances=disturbances,
        shutter=camera.row_timing,
    )


def drive(
    scenario: Scenario,
    start: tuple[float, float, float],
    seed: int,
    source: str = 'features',
    *,
    watch: Callable[[Sample], None] | None = None,
    control: Control | None = None,
) -> RunLog:
    """Drive by ``scenario`` from ``start``: x [m], y [m], heading error [deg]."""
    view, camera = view_of(scenario, source, seed), scenario.camera.nominal_camera
    return Loop(scenario.loop(start, seed), view, camera).run(watch=watch, control=control)
