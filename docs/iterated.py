"""
The iterated scheme under perturbed models (section IX-2): from one attempt's error to the next.

An attempt backs off by a way in proportion to the error that is left, zeroes both epipoles and
drives straight at the goal, as the paper's two steps do. Both epipoles are fed back, so that what
the first step leaves does not depend on where it began: only the second step, which turns by no
command, adds what the model does not have. After Lucibello and Oriolo (2001), the map from one
error to the next is a contraction if that addition vanishes with the way; where it does not
vanish as fast, errors end at a fixed point.

The size of an error (x aside, turned by theta) is h = max(|theta|, sqrt(|x| / 1 m)): who cannot
move sideways needs a way of that order to undo it.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

from visual_servo_epipolar.core.laws.steering import polar_pose

EXCURSION = 2.0  # way back over the size of the error [m]
DISPLACED = 0.3  # bearing at which the current epipole is held while the desired one is zeroed
ATTEMPT_S = 8.0  # time in which an attempt would drive its way: speeds go with it
TURN_GAIN = 4.0  # of turns, over that time; as high as a delayed loop bears
STEPS = 3000  # of an attempt, at most; and in its time
SETTLED = 1e-5


class AttemptError(NamedTuple):
    """Error at the end of an attempt: aside, to the right [m], and heading [rad]."""

    x: float
    heading: float

    @property
    def size(self) -> float:
        """Order of the way that undoes it [m]."""
        return max(abs(self.heading), math.sqrt(abs(self.x)))


@dataclass(frozen=True, kw_only=True)
class Plant:
    """
    A robot other than its nominal model, eq. (4).

    ``curvature`` that its wheels add to every way, forward and ``backward`` [1/m]; ``slip``, the
    part of the way that is lost; ``gain`` of turns to the left over that to the right; ``delay``
    in parts of ATTEMPT_S; ``yaw`` of the camera on the base [rad]; ``focal``, guessed over true.
    """

    curvature: float = 0.0
    backward: float = 0.0
    slip: float = 0.0
    gain: float = 1.0
    delay: float = 0.0
    yaw: float = 0.0
    focal: float = 1.0


WHEELS = 0.05 / 0.33  # curvature of wheels that differ by 5 %, 0.33 m apart [1/m]
PLANTS: dict[str, Plant] = {
    'nominal': Plant(),
    'wheel radii 5 %': Plant(curvature=WHEELS, backward=WHEELS),
    'asymmetric actuation': Plant(curvature=0.5 * WHEELS, backward=-WHEELS, gain=1.1),
    'slip 5 %': Plant(slip=0.05),
    'delay 0.2 s': Plant(delay=0.2 / ATTEMPT_S),
    'camera yaw 2 deg': Plant(yaw=math.radians(2.0)),
    'focal length 10 % off': Plant(focal=1.1),
}


def bound(size: float, plant: Plant) -> float:
    """
    Return the largest size of the next error, from one of this ``size``.

    Over the way s = EXCURSION size of step 2 the heading turns by c s, and the robot moves aside
    by tan(yaw) s + c s^2 / 2, c the curvature: it begins on a line that is turned by the yaw
    against where it drives. A delay lets the desired epipole pass zero by what it drives on.
    """
    way = EXCURSION * size / (1.0 - math.sin(DISPLACED))  # the spiral may lead away from the goal
    curvature = abs(plant.curvature)
    late = plant.delay * math.tan(DISPLACED) * EXCURSION * size
    aside = math.tan(abs(plant.yaw)) * way + 0.5 * curvature * way * way + late
    return max(curvature * way, math.sqrt(aside))


def fixed_point(plant: Plant) -> float:
    """Return the size of the error at which attempts end, by the bound; 0 where none is left."""
    size = 1.0
    for _ in range(200):
        size = min(bound(size, plant), size)
    return size if size > SETTLED else 0.0


def next_error(error: AttemptError, plant: Plant) -> AttemptError:
    """Return the error after one attempt more of ``plant``, from ``error``."""
    robot = _Robot(error, plant, EXCURSION * error.size)
    if robot.way == 0.0:
        return error
    robot.back_off()
    side = -math.copysign(1.0, robot.seen()[1])
    robot.turn_to(side * DISPLACED)
    robot.zero_desired(side)
    robot.turn_to(0.0)
    robot.match()
    return AttemptError(robot.x, robot.heading)


def errors(plant: Plant, first: AttemptError, attempts: int) -> list[AttemptError]:
    """Return the errors at the ends of attempts, the ``first`` before them."""
    course = [first]
    for _ in range(attempts):
        course.append(next_error(course[-1], plant))
    return course


class _Robot:
    """The perturbed robot of one attempt, integrated in steps; commands act late."""

    def __init__(self, error: AttemptError, plant: Plant, way: float) -> None:
        self.x, self.y, self.heading, self.plant, self.way = (
            error.x,
            0.0,
            error.heading,
            plant,
            way,
        )
        self._dt = 2.0 * ATTEMPT_S / STEPS
        self._pending = [(0.0, 0.0)] * round(plant.delay * ATTEMPT_S / self._dt)

    def seen(self) -> tuple[float, float]:
        """Return the bearings of both epipoles, delta and phi, as its camera has them [rad]."""
        pose, plant = polar_pose(self.x, self.y, self.heading), self.plant
        current, desired = pose.delta + plant.yaw, pose.phi + plant.yaw
        return math.atan(plant.focal * math.tan(current)), math.atan(
            plant.focal * math.tan(desired)
        )

    def back_off(self) -> None:
        """Drive back by the way, straight as far as it knows."""
        speed = self.way / ATTEMPT_S
        for _ in range(round(ATTEMPT_S / self._dt)):
            self._move(-speed, 0.0)

    def turn_to(self, bearing: float) -> None:
        """Turn in place until the current epipole is at ``bearing``."""
        for _ in range(STEPS):
            miss = self.seen()[0] - bearing
            if abs(miss) < SETTLED * self.way:
                break
            self._move(0.0, -TURN_GAIN * miss / ATTEMPT_S)

    def zero_desired(self, side: float) -> None:
        """Drive with the current epipole held until the desired one passes zero."""
        speed = self.way / ATTEMPT_S
        for _ in range(20 * STEPS):
            current, desired = self.seen()
            if desired * side >= 0.0:
                break
            self._move(speed, -TURN_GAIN * (current - side * DISPLACED) / ATTEMPT_S * 10.0)
        for _ in range(len(self._pending)):  # what was commanded still acts
            self._move(0.0, 0.0)

    def match(self) -> None:
        """Drive straight, as far as it knows, until the robot is beside the goal: D = 0."""
        while self.y < -1e-6 * self.way:
            self._move(max(-self.y, 0.02 * self.way) / ATTEMPT_S, 0.0)

    def _move(self, linear: float, angular: float) -> None:
        self._pending.append((linear, angular))
        linear, angular = self._pending.pop(0)
        plant = self.plant
        way = (1.0 - plant.slip) * linear * self._dt
        turn = angular * self._dt * (plant.gain if angular > 0.0 else 1.0)
        turn += way * (plant.curvature if way > 0.0 else plant.backward)
        middle = self.heading + 0.5 * turn
        self.x -= way * math.sin(middle)
        self.y += way * math.cos(middle)
        self.heading += turn
