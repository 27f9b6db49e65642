"""Faults in mid-route: the route node drives in the place of the servo, under its name."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    EVERYWHERE,
    Fault,
    Faults,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.judging.witness import SERVO
from visual_servo_epipolar.evaluation.live.world import NODES, WorldSettings
from visual_servo_epipolar.messages.routes.route_folder import write_route
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.simulation.routes.drives import route_scenario, Taught, teach
from visual_servo_epipolar.simulation.routes.ways import rounded
from visual_servo_epipolar.simulation.scenario import Scenario

SCENARIO = route_scenario(Scenario(), 1)
START = 3.0, -3.9, 0.0  # x, y [m], heading error [deg]
WAY = rounded((START[:2], (3.0, -1.2), (4.4, -1.2)))
KINDS = {name: kind for name, kind in NODES.items() if name != 'tracker_node'}


@cache
def taught() -> tuple[Taught, TemporaryDirectory[str]]:
    """Return the route that was taught along WAY, and its folder."""
    folder, route = TemporaryDirectory(), teach(SCENARIO, WAY)
    write_route(route.route, Path(folder.name))
    return route, folder


def on_a_route(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    """Return a world in which the robot repeats a route."""
    return replace(
        settings,
        start=START,
        camera=replace(SCENARIO.camera, seed=settings.seed),
        servo=replace(settings.servo, law='smooth', max_linear=0.5, max_angular=1.0),
        kinds={**KINDS, SERVO: RouteNode},
        more={**settings.more, SERVO: {'route': taught()[1].name}},
    )


def _limits(scene: StruckRun) -> None:
    """Lower a limit of speed and one of turns, by either of their two names."""
    goals, route = scene.witness.record.interventions.goals, taught()[0]
    goals[:] = [route.stations[len(route.route.views) - 1]]
    names = (('max_speed', 'max_linear'), ('max_turn_rate', 'max_angular'))
    values = {pair[int(scene.rng.integers(2))]: scene.draw(0.05, 0.2) for pair in names}
    scene.notes.append(str(values) + scene.world.set(SERVO, values))


ROUTES: Faults = {
    'route_limits_lowered': Fault(
        'limits of speed lowered in mid-route', _limits, on_a_route, phases=EVERYWHERE[:1]
    ),
}
