"""Faults of routes: the route node is in the place of the servo, under its name."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    at_first,
    EVERYWHERE,
    Fault,
    Faults,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.robot import command, ODOMETRY
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


@cache
def new_folders() -> TemporaryDirectory[str]:
    """Return the folder of routes that are yet to be taught."""
    return TemporaryDirectory()


def by_hand(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    """Return a world in which a route is taught."""
    return replace(
        settings,
        servo=replace(settings.servo, autostart=False),
        kinds={**KINDS, SERVO: RouteNode},
        more={**settings.more, SERVO: {'route': f'{new_folders().name}/{settings.seed}'}},
    )


def _leaps(scene: StruckRun) -> None:
    """Drive ahead by hand while a route is taught; odometry leaps on the way."""
    leap, world = scene.draw(0.3, 1.0) * scene.side(), scene.world
    scene.notes.append(f'by {leap:+.2f} m')

    def move(message: Any) -> None:
        message.pose.pose.position.x += leap

    def finish() -> None:
        answer = world.call(f'/{SERVO}/stop_recording')
        if Path(world.settings.more[SERVO]['route']).exists():
            scene.witness.record.wrong_route = answer

    scene.later(1.0, lambda: world.call(f'/{SERVO}/start_recording'))
    for number in range(80):
        scene.later(1.0 + 0.05 * number, lambda: command(scene, 0.3, 0.0))
    scene.later(5.0, lambda: command(scene, 0.0, 0.0))
    scene.later(scene.draw(2.0, 4.0), lambda: scene.alter(ODOMETRY, move))
    scene.later(6.0, finish)


ROUTES: Faults = {
    'teaching_odometry': at_first('odometry leaps while a route is taught', _leaps, by_hand),
    'route_limits_lowered': Fault(
        'limits of speed lowered in mid-route', _limits, on_a_route, phases=EVERYWHERE[:1]
    ),
}
