"""Kidnaps: the robot is put anywhere, on a route or off it, and says where it is, or that not."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.geometry.motion import Pose, wrap_angle
from visual_servo_epipolar.core.routes.following.closing import closing_of
from visual_servo_epipolar.core.routes.places import Place, PlaceFinder
from visual_servo_epipolar.simulation.rooms.floor_plan import PLAN
from visual_servo_epipolar.simulation.routes.drives import new_simulator, Taught
from visual_servo_epipolar.simulation.routes.ways import SPACING
from visual_servo_epipolar.simulation.scenario import Scenario

ASIDE, TURNED = 0.5, math.radians(20.0)  # most of a start beside the route [m, rad]
WALL = 0.6  # distance from walls of a start anywhere [m]
RIGHT_WAY, RIGHT_OFFSET = 0.3, 0.1  # errors of a place that is right [m]


@dataclass(frozen=True, slots=True)
class Kidnaps:
    """How many starts were ``tried``, found ``right``, ``refused``, or found ``wrong``."""

    tried: int
    right: int
    refused: int
    wrong: int


def kidnap(scenario: Scenario, taught: Taught, count: int, seed: int) -> Kidnaps:
    """
    Put the robot beside the route ``count`` times, and judge where it says that it is.

    A camera that sees all around is turned anyhow.
    """
    simulator, finder = new_simulator(scenario), PlaceFinder(taught.route)
    closing = closing_of(taught.route, finder)
    rng = np.random.default_rng((seed, 11))
    turned = math.pi if scenario.camera.camera.wraps else TURNED
    right = refused = 0
    for number in range(count):
        k, offset = int(rng.integers(0, len(taught.way.points) - 40)), float(rng.uniform(-1, 1))
        pose = _beside(taught, k, ASIDE * offset, turned * float(rng.uniform(-1.0, 1.0)))
        place = finder.find(simulator.capture(pose, number))
        if place is not None and closing is not None:  # right by either end of the way
            place = closing.on_lap(place, taught.route.views, k * SPACING)
        refused += place is None
        right += place is not None and _is_right(taught, place, pose)
    return Kidnaps(count, right, refused, count - right - refused)


def kidnap_elsewhere(scenario: Scenario, taught: Taught, count: int, seed: int) -> Kidnaps:
    """Put the robot anywhere in the storey of the ``scenario``, another one than that taught."""
    simulator, finder = new_simulator(scenario), PlaceFinder(taught.route)
    found = [
        finder.find(simulator.capture(pose, k)) for k, pose in enumerate(_anywhere(count, seed))
    ]
    refused = sum(place is None for place in found)
    return Kidnaps(count, 0, refused, count - refused)


def _beside(taught: Taught, k: int, offset: float, turn: float) -> Pose:
    ahead = taught.way.points[k + 4] - taught.way.points[k]
    heading = math.atan2(ahead[1], ahead[0])
    x, y = (
        taught.way.points[k] + [-offset * math.sin(heading), offset * math.cos(heading)]
    ).tolist()
    return Pose(x, y, wrap_angle(heading + turn))


def _anywhere(count: int, seed: int) -> Iterator[Pose]:
    rng = np.random.default_rng((seed, 12))
    for _ in range(count):
        cell = PLAN.cells[int(rng.integers(len(PLAN.cells)))]
        low, high = (cell.x0 + WALL, cell.y0 + WALL), (cell.x1 - WALL, cell.y1 - WALL)
        x, y = rng.uniform(low, high).tolist()
        yield Pose(x, y, float(rng.uniform(-math.pi, math.pi)))


def _is_right(taught: Taught, place: Place, pose: Pose) -> bool:
    """Whether a place is where the robot is: odometry's ways are not quite true ones."""
    ratio = float(taught.way.length[-1]) / taught.route.length
    k = round(place.way * ratio / SPACING)
    k, offset = taught.way.offset(pose, min(max(k, 0), len(taught.way.points) - 1))
    apart = abs(k * SPACING - place.way * ratio)
    return apart < RIGHT_WAY and abs(offset - place.offset) < RIGHT_OFFSET
