"""Wheel odometry in closed loops: it sharpens the scale of the memory, and its lies do no harm."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
import math

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.geometry.motion import integrate, motion_between, Pose, Twist
from visual_servo_epipolar.core.servo.run_log import RunLog, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.simulation.closed_loop import Loop, LoopSettings, View
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load, Scenario
from visual_servo_epipolar.simulation.views import points_of

SEED, SEEDS = 21, (1, 2)
TRACK = 0.33  # of the wheels [m]
FAR = 0.3  # where the distance is compared [m]
LATE = 0.6  # of the error
Lie = Callable[[Pose, Pose], Pose]  # of the last pose that was told and the true one


def scenario_of(seed: int, *, odometry: bool = True, name: str = 'nominal') -> Scenario:
    return load(scenario_path(name)).with_servo({'odometry': odometry}).seeded(seed)


def parts(scenario: Scenario, seed: int) -> tuple[LoopSettings, View, object]:
    start = start_in('front', SEED, seed, scenario)
    return scenario.loop(start, seed), points_of(scenario, seed), scenario.camera.nominal_camera


@dataclass
class Control:
    """The servo, with odometry that begins to ``lie`` at an image; what it thinks is kept."""

    lie: Lie | None = None
    begins: int = 0
    images: int = 0
    told: Pose | None = None
    distances: list[float] = field(default_factory=list)
    state: ServoState = field(default_factory=ServoState)

    def __call__(
        self, state: ServoState, observation: Observation, settings: ServoSettings
    ) -> ServoState:
        said = observation.odometry
        if said is not None:
            if self.lie is not None and self.told is not None and self.images >= self.begins:
                said = self.lie(self.told, said)
            self.told = said
        self.images += 1
        self.state = step(state, replace(observation, odometry=said), settings)
        measurement = self.state.measurement
        offset = None if measurement is None else measurement.offset
        self.distances.append(math.nan if offset is None else math.hypot(*offset))
        return self.state


def driven(seed: int, control: Control, *, odometry: bool = True, end_s: float = 200.0) -> RunLog:
    loop, view, camera = parts(scenario_of(seed, odometry=odometry), seed)
    return Loop(replace(loop, max_duration=end_s), view, camera).run(control=control)


def errors(*, odometry: bool, seeds: tuple[int, ...] = SEEDS) -> np.ndarray:
    """Return the errors of the logarithm of the remembered distance, of all images far off."""
    found = []
    for seed in seeds:
        control = Control()
        log = driven(seed, control, odometry=odometry, end_s=25.0)  # far off until then
        for sample, distance in zip(log.samples, control.distances, strict=False):
            if distance > 0.0 and sample.pose.distance > FAR:
                found.append(math.log(distance / sample.pose.distance))
    return np.array(found)


def test_the_remembered_distance_is_that_of_the_wheels() -> None:
    with_it, without = (np.abs(errors(odometry=it)) for it in (True, False))
    assert np.median(with_it) < 0.8 * np.median(without)
    assert np.percentile(with_it, 95) < 0.7 * np.percentile(without, 95)


def test_odometry_that_is_proven_late_measures_the_way_before_as_well() -> None:
    """It starts straight ahead; what was commanded on the first metre was not driven yet."""
    with_it, without = (np.median(np.abs(errors(odometry=it, seeds=(0,)))) for it in (True, False))
    assert with_it < LATE * without


def test_without_the_setting_no_odometry_reaches_the_servo() -> None:
    control = Control()
    driven(1, control, odometry=False)
    assert control.told is None
    assert control.state.identified.odometry.pose is None


def test_odometry_that_is_not_wanted_changes_nothing() -> None:
    """As in a replay with other settings: the pose is there, and is not used."""
    loop, view, camera = parts(scenario_of(1, odometry=False), 1)
    loop = replace(loop, max_duration=10.0)
    plain, wheels = Loop(loop, view, camera).run(), [Pose(1.0, 2.0, 3.0)]

    def unwanted(
        state: ServoState, observation: Observation, settings: ServoSettings
    ) -> ServoState:
        wheels.append(integrate(wheels[-1], state.twist, 1.0 / 11.0))
        return step(state, replace(observation, odometry=wheels[-1]), settings)

    again = Loop(loop, view, camera).run(control=unwanted)
    assert repr(again) == repr(plain)


def frozen(last: Pose, true: Pose) -> Pose:
    return last


def mirrored(last: Pose, true: Pose) -> Pose:
    return Pose(true.x, -true.y, -true.theta)


class Wrong:
    """Wheels whose motion is another than they say: way and turn over the true ones."""

    def __init__(self, way: float, turn: float, of_turn: float = 0.0) -> None:
        self.way, self.turn, self.of_turn = way, turn, of_turn
        self.before: Pose | None = None

    def __call__(self, last: Pose, true: Pose) -> Pose:
        before, self.before = self.before or true, true
        way, turn = motion_between(before, true)
        linear = self.way * way + self.of_turn * turn
        # One wheel alone turns the robot about the other one.
        angular = self.turn * turn + (way / TRACK if self.of_turn else 0.0)
        return integrate(last, Twist(linear, angular), 1.0)


def unplugged() -> Wrong:
    return Wrong(0.5, 0.5, 0.25 * TRACK)


def shuffled() -> Lie:
    rng = np.random.default_rng(1)
    return lambda last, true: Pose(*rng.uniform(-3.0, 3.0, 3).tolist())


LIES: dict[str, Callable[[], Lie]] = {
    'frozen': lambda: frozen,
    'mirrored': lambda: mirrored,
    'twice as large': lambda: Wrong(2.0, 2.0),
    'half as large': lambda: Wrong(0.5, 0.5),
    'twice as far': lambda: Wrong(2.0, 1.0),
    'a wheel unplugged': unplugged,
    'any pose': shuffled,
}


@pytest.mark.parametrize(
    ('name', 'begins'),
    few_of(
        [('frozen', 1), ('twice as far', 30), *((name, 60) for name in reversed(LIES))],
        keep=(1, 3),
    ),
)
def test_a_lie_is_found_out_and_the_robot_arrives(name: str, begins: int) -> None:
    control = Control(LIES[name](), begins)
    log = driven(2, control)
    summary = summarise(log)
    assert control.state.identified.odometry.refuted
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.003
    assert summary['duration_s'] < 100.0  # one of sixteen starts takes 82, others 65
    # The scale is that of the commands again.
    sample = next(it for it in log.samples[::-1] if it.pose.distance > FAR)
    distance = control.distances[log.samples.index(sample)]
    assert distance == pytest.approx(sample.pose.distance, rel=0.12)


def test_a_reset_is_no_lie() -> None:
    origin: list[Pose] = []

    def reset(last: Pose, true: Pose) -> Pose:
        if not origin:
            origin.append(true)
        x, y = true.x - origin[0].x, true.y - origin[0].y
        cosine, sine = math.cos(origin[0].theta), math.sin(origin[0].theta)
        turn = math.remainder(true.theta - origin[0].theta, 2.0 * math.pi)
        return Pose(cosine * x + sine * y, cosine * y - sine * x, turn)

    control = Control(reset, 120)
    summary = summarise(driven(2, control))
    assert not control.state.identified.odometry.refuted
    assert control.state.identified.odometry.proven
    assert summary['outcome'] == 'arrived'
    assert summary['position_error_m'] < 0.0015
