"""Routes in simulation: ways, a driver, a way taught and repeated, changed worlds, kidnaps."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist, wrap_angle
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.routes.follower import RouteProgress
from visual_servo_epipolar.core.routes.places import Place, PlaceFinder
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import refuse_heads, RouteRun, RouteStep
from visual_servo_epipolar.core.routes.settings import FollowSettings, TeachSettings
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.closed_loop import DrivenBase
from visual_servo_epipolar.simulation.light import LightSettings
from visual_servo_epipolar.simulation.rooms.storey import CELLS
from visual_servo_epipolar.simulation.scenario import Scenario

RADIUS = 1.15  # of corners [m]
SPACING = 0.01  # of points on a way [m]
LOOKAHEAD = 0.35  # of the driver [m]

# Corners of ways (x, y) [m]: through doors, along corridors, and across themselves.
ROOMS = ((9.5, -1.2), (9.5, 6.0), (2.5, 6.0), (2.5, 10.2), (8.0, 10.2))
RING = ((-1.2, -1.2), (-1.2, 10.2), (15.2, 10.2), (15.2, -1.2))
WAYS: Mapping[str, Sequence[tuple[float, float]]] = {
    'short': ((3.0, -7.6), (3.0, -1.2), (9.5, -1.2), (9.5, 3.5)),
    'loop': ((3.2, -7.2), (5.4, -7.2), (5.4, -3.8), (1.6, -3.8), (1.6, -7.2), (3.2, -7.2)),
    'rooms': ((3.0, -7.6), (3.0, -1.2), *ROOMS),
    'ring': ((4.0, -1.2), *RING[::-1], (4.0, -1.2)),
    'long': ((11.0, -7.6), (11.0, -1.2), *RING, *ROOMS),
}


@dataclass(frozen=True, eq=False)
class DrivenWay:
    """Points along a way, (M, 2), SPACING apart or nearly."""

    points: FloatArray

    @cached_property
    def length(self) -> FloatArray:
        """Way to each point [m], (M,)."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def start(self) -> Pose:
        """Pose at its beginning."""
        ahead = self.points[1] - self.points[0]
        x, y = self.points[0].tolist()
        return Pose(x, y, math.atan2(ahead[1], ahead[0]))

    def nearest(self, x: float, y: float, near: int, reach: int = 200) -> int:
        """Return the number of the nearest point, ``reach`` points around number ``near``."""
        first = max(near - reach, 0)
        part = self.points[first : near + reach + 1] - [x, y]
        return first + int(np.argmin((part * part).sum(1)))

    def offset(self, pose: Pose, near: int) -> tuple[int, float]:
        """Return the nearest point's number, and how far left of the way a pose is [m]."""
        k = self.nearest(pose.x, pose.y, near)
        before, after = self.points[max(k - 1, 0)], self.points[min(k + 1, len(self.points) - 1)]
        tangent = (after - before) / np.linalg.norm(after - before)
        away = np.array([pose.x, pose.y]) - self.points[k]
        return k, float(tangent[0] * away[1] - tangent[1] * away[0])


def way_named(name: str) -> DrivenWay:
    """Return the way of that name, with rounded corners; KeyError if there is none."""
    return rounded(WAYS[name])


def rounded(corners: Sequence[tuple[float, float]]) -> DrivenWay:
    """Return the way along straights, with corners rounded by RADIUS."""
    places = [np.array(corner) for corner in corners]
    parts, at = [], places[0]
    for before, corner, after in zip(places[:-2], places[1:-1], places[2:], strict=True):
        first = (corner - before) / np.linalg.norm(corner - before)
        second = (after - corner) / np.linalg.norm(after - corner)
        turn = wrap_angle(math.atan2(second[1], second[0]) - math.atan2(first[1], first[0]))
        cut = RADIUS * math.tan(0.5 * abs(turn))
        entry = corner - cut * first
        side = math.copysign(1.0, turn)
        centre = entry + RADIUS * side * np.array([-first[1], first[0]])
        parts.append(_straight(at, entry))
        angles = np.arange(0.0, abs(turn), SPACING / RADIUS)
        begin = entry - centre
        cos, sin = np.cos(side * angles), np.sin(side * angles)
        turned = np.stack([cos * begin[0] - sin * begin[1], sin * begin[0] + cos * begin[1]], 1)
        parts.append(centre + turned)
        at = corner + cut * second
    parts.append(_straight(at, places[-1]))
    parts.append(places[-1][None])
    return DrivenWay(np.concatenate(parts))


def _straight(start: FloatArray, end: FloatArray) -> FloatArray:
    count = max(int(np.linalg.norm(end - start) / SPACING), 1)
    return np.asarray(start + np.arange(count)[:, None] / count * (end - start))


class Driver:
    """Drives along a way by pure pursuit of ground truth, as a person with a joystick would."""

    def __init__(self, way: DrivenWay, speed: float) -> None:
        self._way, self._speed, self._near = way, speed, 0

    def twist(self, pose: Pose) -> Twist:
        """Return the command at a pose."""
        self._near = self._way.nearest(pose.x, pose.y, self._near)
        ahead = min(self._near + round(LOOKAHEAD / SPACING), len(self._way.points) - 1)
        x, y = (self._way.points[ahead] - [pose.x, pose.y]).tolist()
        distance = max(math.hypot(x, y), 1e-3)
        bearing = wrap_angle(math.atan2(y, x) - pose.theta)
        left = float(self._way.length[-1] - self._way.length[self._near])
        speed = min(self._speed, math.sqrt(2.0 * 0.25 * max(left - 0.02, 0.0)))
        return Twist(speed, 2.0 * speed * math.sin(bearing) / max(distance, LOOKAHEAD))

    @property
    def is_there(self) -> bool:
        """Whether the end is reached."""
        return float(self._way.length[-1] - self._way.length[self._near]) < 0.03


def world_of(scenario: Scenario, name: str, seed: int) -> Scenario:
    """
    Return a ``scenario`` in the world of that name: same, as it is, or all.

    In all the storey has changed, grey is of another gamma, and people walk through the image, as
    ``seed`` draws it.
    """
    if name == 'same':
        return scenario
    rng = np.random.default_rng((seed, 13))
    gamma = math.exp(float(rng.uniform(*np.log((0.4, 2.5)))))
    height, since, still = float(rng.uniform(0.5, 1.0)), *rng.integers((20, 22), (70, 45))
    disturbances = replace(
        scenario.disturbances,
        disturbed_from=int(since),
        disturbed_for=int(still),
        disturbed_every=int(still) + 60,
        person=height,
    )
    light = replace(scenario.light, changed_by=seed, gamma=gamma)
    return replace(scenario, light=light, disturbances=disturbances)


REST_FRAMES = 8  # after the last command, until the base stands
WRONG_OFFSET, WRONG_STATION, WRONG_HEADING = 0.05, 0.02, math.radians(0.5)  # silently [m, rad]
LONGEST = 4.0  # times that a run may take, of driving at full speed
SIZE, FOCAL = (640, 480), 385.0  # of the camera of routes [px]


def route_scenario(scenario: Scenario, seed: int) -> Scenario:
    """
    Return a ``scenario`` in the storey of a seed; a pinhole has images of 640x480.

    Raises InputError for a camera on a head.
    """
    try:
        refuse_heads(scenario.servo)
    except ValueError as error:
        raise InputError(f'{error}; or leave out --rig') from None
    camera = replace(scenario.camera, scene='storey', scene_seed=seed)
    if camera.camera.planar is not None:
        camera = replace(
            camera,
            width=SIZE[0],
            height=SIZE[1],
            focal_length=FOCAL,
            principal_u=0.5 * (SIZE[0] - 1),
            principal_v=0.5 * (SIZE[1] - 1),
        )
    return replace(scenario, camera=camera)


def new_simulator(scenario: Scenario) -> CameraSimulator:
    """Return the camera in the world of a ``scenario``, by its light and its disturbances."""
    return CameraSimulator(scenario.camera, scenario.disturbances, scenario.light)


@dataclass(frozen=True, eq=False)
class Taught:
    """A route, the true way that was driven, and the true poses of its stations by key view."""

    route: Route
    way: DrivenWay
    stations: dict[int, Pose]


def teach(
    scenario: Scenario,
    way: DrivenWay,
    *,
    speed: float = 0.5,
    settings: TeachSettings | None = None,
    watch: Callable[[Image, int, Pose], None] = lambda image, stamp_ns, odometry: None,
) -> Taught:
    """
    Drive along a ``way``, and return the route that is learnt; ``watch`` is shown the same.

    The light is that of the photograph, and nothing has changed.
    """
    driver = Driver(way, speed)
    light = scenario.light.photograph_light
    lit = LightSettings(light=light, photograph_light=light, exposure=scenario.light.exposure)
    simulator = CameraSimulator(scenario.camera, None, lit)
    driven = driven_in(scenario, way.start, scenario.camera.seed)
    teacher = Teacher(scenario.camera.nominal_camera, settings)
    poses: list[Pose] = []
    rest = REST_FRAMES
    while rest:
        image = simulator.capture(driven.exposed_at, driven.frame, driven.motion)
        odometry = driven.base.odometry
        teacher.add(image, driven.now_ns, odometry)
        watch(image, driven.now_ns, odometry)
        poses.append(driven.shown)
        rest -= driver.is_there
        driven.drive(Command(STANDSTILL if driver.is_there else driver.twist(driven.pose)))
    route = teacher.finish()
    return Taught(route, _resampled(poses), {0: poses[0], len(route.views) - 1: poses[-1]})


def driven_in(scenario: Scenario, start: Pose, seed: int) -> DrivenBase:
    """Return the base of a ``scenario`` at ``start``, and when its camera takes images."""
    base = scenario.base.base(start, seed=seed)
    return DrivenBase(base, scenario.camera.frame_rate, scenario.camera.receipt)


def _resampled(poses: list[Pose]) -> DrivenWay:
    points = np.array([[pose.x, pose.y] for pose in poses])
    length = DrivenWay(points).length
    moved = np.concatenate([[True], np.diff(length) > 1e-6])
    at = np.arange(0.0, length[-1], SPACING)
    columns = [np.interp(at, length[moved], column) for column in points[moved].T]
    return DrivenWay(np.stack(columns, axis=1))


class RouteSample(NamedTuple):
    """A step of a repetition: true pose and true offset from the taught way, and what was done."""

    stamp_ns: int
    pose: Pose
    offset: float
    progress: RouteProgress
    twist: Twist
    lap: int = 1

    @property
    def is_wrong(self) -> bool:
        """Whether a view is trusted, and the robot elsewhere beside the way than estimated."""
        off = abs(self.offset - self.progress.lateral)
        return self.progress.inliers > 0 and off > WRONG_OFFSET


@dataclass(eq=False)
class RepeatLog:
    """Record of a repetition; errors of the station, (position [m], heading [rad]), at its end."""

    samples: list[RouteSample] = field(default_factory=list)
    outcome: str = 'failed'
    reason: str = ''
    station: tuple[float, float] = (math.nan, math.nan)
    duration_s: float = 0.0
    length: float = 0.0  # that the robot drove [m]
    route: Route | None = None  # with photographs of today, after an arrival that renewed it

    @property
    def is_wrong(self) -> bool:
        """Whether it was wrong and did not know: on the way, or by an arrival elsewhere."""
        position, heading = self.station
        elsewhere = position > WRONG_STATION or abs(heading) > WRONG_HEADING
        return elsewhere or any(sample.is_wrong for sample in self.samples)

    @property
    def standstills(self) -> int:
        """How often it stood on the way, before the servo took over at the station."""
        stands = [sample.twist == STANDSTILL for sample in self.samples]
        begun = stands[stands.index(False) :] if False in stands else []
        return sum(after and not before for before, after in pairwise(begun))

    @property
    def offsets(self) -> FloatArray:
        """True offsets from the taught way, (M,) [m]."""
        return np.array([sample.offset for sample in self.samples])

    def laps(self) -> list[FloatArray]:
        """Return the true offsets of each lap, (M,) each [m]."""
        count = max((sample.lap for sample in self.samples), default=0)
        return [
            np.array([sample.offset for sample in self.samples if sample.lap == lap])
            for lap in range(1, count + 1)
        ]

    def turn_jump(self, max_turn_rate: float) -> float:
        """Return the largest change of w in a step that changed the key view, a share of most."""
        jumps = [
            abs(after.twist.angular - before.twist.angular)
            for before, after in pairwise(self.samples)
            if after.progress.switched
        ]
        return max(jumps, default=0.0) / max_turn_rate


def repeat(
    scenario: Scenario,
    taught: Taught,
    settings: FollowSettings,
    *,
    start: Pose | None = None,
    watch: Callable[[Image, Pose, RouteStep], None] = lambda image, pose, step: None,
) -> RepeatLog:
    """Repeat a route to its end, from its beginning or from any ``start``; return the record."""
    simulator, last = new_simulator(scenario), len(taught.route.views) - 1
    begin, end = (last, 0) if settings.reverse else (0, last)
    driven = driven_in(scenario, start or taught.stations[begin], scenario.camera.seed + 1)
    way = None if start else taught.route.views[begin].way
    camera = scenario.camera.nominal_camera
    servo = replace(scenario.servo, latency=scenario.base.command_delay)  # as an owner measures
    run = RouteRun(taught.route, settings, servo, camera=camera, way=way)
    log, near, rest = RepeatLog(), -1, REST_FRAMES
    lap_s = LONGEST * taught.route.length / settings.max_speed + scenario.run.max_duration
    limit_s, lap = settings.laps * lap_s, 1
    while rest and driven.now_ns < limit_s * NANOSECONDS:
        pose, stamp_ns = driven.shown, driven.now_ns
        image = simulator.capture(driven.exposed_at, driven.frame, driven.motion)
        step = run.step(image, stamp_ns)
        watch(image, pose, step)
        if step.progress is not None:
            if near < 0 or run.lap != lap:
                near, lap = round(step.progress.way / SPACING), run.lap
            near, offset = taught.way.offset(pose, near)
            log.samples.append(RouteSample(stamp_ns, pose, offset, step.progress, step.twist, lap))
        rest -= run.ended
        before = driven.pose
        driven.drive(Command(step.twist))
        log.length += math.hypot(driven.pose.x - before.x, driven.pose.y - before.y)
    log.outcome, log.reason = (step.phase, step.reason) if run.ended else ('failed', 'out of time')
    log.duration_s = driven.now_ns / NANOSECONDS
    if log.outcome == Phase.ARRIVED.value:
        it, true = driven.pose, taught.stations[end]
        log.station = math.hypot(it.x - true.x, it.y - true.y), wrap_angle(it.theta - true.theta)
        log.route = run.renewed() if settings.renewals else None
    return log


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
    turned = math.pi if scenario.camera.camera.wraps else TURNED
    return _judged(scenario, taught, _beside(taught, count, seed, turned))


def kidnap_elsewhere(scenario: Scenario, taught: Taught, count: int, seed: int) -> Kidnaps:
    """Put the robot anywhere in the storey of the ``scenario``, another one than that taught."""
    return _judged(scenario, taught, _anywhere(count, seed), on_route=False)


def _judged(
    scenario: Scenario, taught: Taught, poses: Iterable[Pose], *, on_route: bool = True
) -> Kidnaps:
    """Let the robot look for its place on the route at each of ``poses``."""
    simulator, finder = new_simulator(scenario), PlaceFinder(taught.route)
    tried = right = refused = 0
    for tried, pose in enumerate(poses, start=1):
        place = finder.find(simulator.capture(pose, tried - 1))
        if place is None:
            refused += 1
        elif on_route:
            right += _is_right(taught, place, pose, finder.lap)
    return Kidnaps(tried, right, refused, tried - right - refused)


def _beside(taught: Taught, count: int, seed: int, turned: float) -> Iterator[Pose]:
    rng, points = np.random.default_rng((seed, 11)), taught.way.points
    for _ in range(count):
        k, offset = int(rng.integers(0, len(points) - 40)), ASIDE * float(rng.uniform(-1, 1))
        ahead = points[k + 4] - points[k]
        heading = math.atan2(ahead[1], ahead[0])
        x, y = (points[k] + [-offset * math.sin(heading), offset * math.cos(heading)]).tolist()
        yield Pose(x, y, wrap_angle(heading + turned * float(rng.uniform(-1.0, 1.0))))


def _anywhere(count: int, seed: int) -> Iterator[Pose]:
    rng = np.random.default_rng((seed, 12))
    for _ in range(count):
        cell = CELLS[int(rng.integers(len(CELLS)))]
        low, high = (cell.x0 + WALL, cell.y0 + WALL), (cell.x1 - WALL, cell.y1 - WALL)
        x, y = rng.uniform(low, high).tolist()
        yield Pose(x, y, float(rng.uniform(-math.pi, math.pi)))


def _is_right(taught: Taught, place: Place, pose: Pose, lap: float) -> bool:
    """Whether a place is where the robot is: odometry's ways are not quite true ones."""
    ratio, last = float(taught.way.length[-1]) / taught.route.length, len(taught.way.points) - 1
    ways = [place.way, place.way + lap, place.way - lap]  # right by either end of a lap
    for way in (ratio * it for it in ways if math.isfinite(it)):
        k, offset = taught.way.offset(pose, min(max(round(way / SPACING), 0), last))
        if abs(k * SPACING - way) < RIGHT_WAY and abs(offset - place.offset) < RIGHT_OFFSET:
            return True
    return False
