"""A few metres, taught and repeated: on images, judged by ground truth alone."""

from collections.abc import Iterator
from dataclasses import replace
import math
from pathlib import Path

import cv2
from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.routes.chain import seam
from visual_servo_epipolar.core.routes.follower import RouteProgress
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.places import PlaceFinder
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import Docking, RouteRun, RouteStep
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.routes.structure import ViewPose
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.simulation.bases import PioneerSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.routes import (
    DrivenWay,
    kidnap,
    repeat,
    RepeatLog,
    rounded,
    route_scenario,
    RouteSample,
    Taught,
    teach,
    way_named,
    world_of,
)
from visual_servo_epipolar.simulation.scenario import load, Scenario

SCENARIO = route_scenario(Scenario(base=PioneerSettings(wheel_ratio=1.01)), 1).with_servo(
    {'law': 'smooth', 'max_linear': 0.5, 'max_angular': 1.0}
)
SETTINGS = FollowSettings()
MIDWAY = Pose(3.0, -2.2, 0.5 * np.pi)


@pytest.fixture(scope='module')
def taught() -> Taught:
    return teach(SCENARIO, rounded(((3.0, -3.9), (3.0, -1.2), (4.4, -1.2))))


def test_the_seam_between_key_views_is_millimetres(taught: Taught) -> None:
    assert np.sqrt(np.nanmean(seam(taught.route.views) ** 2)) < 2e-3


def test_key_views_are_close_where_the_view_changes(taught: Taught) -> None:
    ways = np.array([view.way for view in taught.route.views])
    assert np.diff(ways).min() < 0.7 < np.diff(ways).max() < 1.65


def test_a_taught_way_is_repeated_to_millimetres(taught: Taught) -> None:
    log = repeat(SCENARIO.seeded(5), taught, SETTINGS)
    assert log.outcome == 'arrived', log.reason
    offsets = np.abs(log.offsets)
    assert np.sqrt((offsets**2).mean()) < 4e-3 and offsets.max() < 0.015
    assert log.station[0] < 3e-3 and abs(log.station[1]) < np.radians(0.1)
    assert log.turn_jump(SETTINGS.max_turn_rate) < 0.05


def test_a_cheap_camera_on_a_body_that_nods_repeats_it(taught: Taught) -> None:
    camera = replace(SCENARIO.camera, readout=0.03, stamp_delay=0.12, stamp_jitter=0.01)
    cheap = replace(SCENARIO, camera=camera, base=PioneerSettings(nod=0.0175, acceleration=1.0))
    moved: list[np.ndarray] = []
    log = repeat(cheap, taught, SETTINGS, watch=lambda image, *_: moved.append(image))
    assert log.outcome == 'arrived', log.reason
    assert np.abs(log.offsets).max() < 0.03 and log.station[0] < 0.01
    # Images are late, and show that the body nods as the robot sets off.
    stamps = np.array([sample.stamp_ns for sample in log.samples])
    assert stamps[0] > 0.05e9 and len(set(np.diff(stamps).tolist())) > 10
    still = CameraSimulator(camera, cheap.disturbances, cheap.light)
    level = [still.capture(sample.pose, k) for k, sample in enumerate(log.samples[:12])]
    assert any(
        np.mean(cv2.absdiff(a, b)) > 3.0 for a, b in zip(moved[2:], level[2:], strict=False)
    )


def test_a_camera_that_was_calibrated_anew_repeats_as_exactly(taught: Taught) -> None:
    """Its focus and its axis have changed by 0.6 deg at the edge, and camera_info says so."""
    camera = replace(SCENARIO.camera, focal_length=387.0, principal_u=322.5, principal_v=237.5)
    log = repeat(replace(SCENARIO, camera=camera).seeded(5), taught, SETTINGS)
    assert log.outcome == 'arrived', log.reason
    assert np.sqrt((log.offsets**2).mean()) < 4e-3
    assert log.station[0] < 3e-3 and abs(log.station[1]) < np.radians(0.1)


def test_a_way_is_repeated_backward(taught: Taught) -> None:
    log = repeat(SCENARIO.seeded(9), taught, replace(SETTINGS, reverse=True), start=MIDWAY)
    assert log.outcome == 'arrived', log.reason
    assert np.abs(log.offsets).max() < 0.02
    assert min(sample.twist.linear for sample in log.samples) < -0.3
    assert log.station[0] < 3e-3


def test_progress_of_a_robot_that_stands_does_not_move(taught: Taught) -> None:
    simulator = CameraSimulator(SCENARIO.seeded(6).camera)
    run = RouteRun(taught.route, SETTINGS, SCENARIO.servo, way=0.0)
    ways = []
    while not run.ended and len(ways) < 100:
        image = simulator.capture(taught.stations[0], len(ways))
        step = run.step(image, round(len(ways) * 9e7))
        ways += [] if step.progress is None else [step.progress.way]
    assert len(ways) > 10 and np.ptp(ways) < 0.01
    assert step.phase == 'failed' and 'commanded to drive' in step.reason


def test_a_robot_that_is_carried_along_the_route_finds_itself_again(taught: Taught) -> None:
    """It is lifted and put down 1.5 m farther on, where the key view ahead is not in view."""
    simulator = CameraSimulator(SCENARIO.seeded(6).camera)
    run = RouteRun(taught.route, SETTINGS, SCENARIO.servo, way=0.0)
    poses = [taught.stations[0], replace(taught.stations[0], x=3.05, y=-2.0, theta=1.4)]
    for k in range(60):
        step = run.step(simulator.capture(poses[k > 3], k), round(k * 9e7))
        if k > 20 and step.phase == 'following':
            break
    assert step.progress is not None and abs(step.progress.way - 1.9) < 0.1, step
    _, offset = taught.way.offset(poses[1], 190)
    assert step.progress.lateral == pytest.approx(offset, abs=0.02)


def test_a_view_far_off_is_not_believed_however_long_it_is_seen(taught, monkeypatch) -> None:
    """Somebody walks along, and what moves with him agrees on a place that is none."""
    run = RouteRun(taught.route, SETTINGS, SCENARIO.servo, way=0.0)
    image = CameraSimulator(SCENARIO.camera).capture(taught.stations[0], 0)
    steps = [run.step(image, round(k * 9e7)) for k in range(3)]
    assert all(step.progress is not None and step.progress.inliers for step in steps)
    locate = KeyViewTracker.locate

    def turned(tracker: KeyViewTracker, image: Image, near: FloatArray) -> ViewPose | None:
        found = locate(tracker, image, near)
        return found and found._replace(pose=found.pose - [0.0, 0.0, 0.25])

    monkeypatch.setattr(KeyViewTracker, 'locate', turned)
    monkeypatch.setattr(PlaceFinder, 'find', lambda *_: None)
    steps = [run.step(image, round(k * 9e7)) for k in range(3, 23)]
    assert not any(step.progress is None or step.progress.inliers for step in steps)
    assert steps[-1].phase == 'holding' and steps[-1].twist == STANDSTILL


def test_a_robot_that_was_kidnapped_finds_itself_where_all_has_changed(taught: Taught) -> None:
    start = replace(MIDWAY, x=MIDWAY.x + 0.1, theta=1.45)
    settings = replace(SETTINGS, renewals=2)
    log = repeat(world_of(SCENARIO.seeded(8), 'all', 8), taught, settings, start=start)
    assert log.outcome == 'arrived', log.reason
    assert log.station[0] < 3e-3 and abs(log.offsets[-1]) < 0.01
    assert not log.is_wrong and log.standstills == 0
    assert log.route is not None and 0 < sum(len(view.renewed) for view in log.route.views)
    for view, first in zip(log.route.views, taught.route.views, strict=True):
        assert view.load is first.load and view.structure is first.structure


def test_a_robot_that_trusts_a_view_and_is_elsewhere_is_silently_wrong() -> None:
    pose, way = Pose(0.0, 0.0, 0.0), RouteProgress(1, 1.0, 2.0, 0.0, 0.01, 0.0, 30)
    samples = [
        RouteSample(0, pose, offset, replace(way, inliers=inliers), twist)
        for offset, inliers, twist in (
            (0.02, 30, STANDSTILL),
            (0.02, 30, Twist(0.5, 0.0)),
            (0.15, 0, STANDSTILL),
            (0.15, 0, STANDSTILL),
            (0.02, 30, Twist(0.5, 0.0)),
        )
    ]
    log = RepeatLog(samples, 'arrived', station=(0.001, 0.0))
    assert log.standstills == 1 and not log.is_wrong
    wrong = samples[2]._replace(progress=way)
    assert RepeatLog([*samples[:2], wrong], 'failed').is_wrong
    assert replace(log, station=(0.03, 0.0)).is_wrong


def test_of_rooms_that_look_alike_only_one_nearby_is_believed(taught: Taught) -> None:
    views, farther = taught.route.views, taught.route.length + 10.0
    again = [
        replace(
            view,
            way=view.way + farther,
            pose=view.pose + [farther, 0.0, 0.0],
            path=replace(view.path, way=view.path.way + farther),
        )
        for view in views
    ]
    finder, image = PlaceFinder(Route(taught.route.camera, (*views, *again))), views[2].image
    assert finder.find(image) is None and finder.reason
    for first in (0, len(views)):
        place = finder.find(image, range(first, first + 5))
        assert place is not None, finder.reason
        assert place.way == pytest.approx(views[2].way + farther * (first > 0), abs=0.05)


def commands(
    taught: Taught, settings: FollowSettings, count: int = 40, **servo: float
) -> Iterator[tuple[RouteRun, Twist]]:
    """Yield a run along a route and each of its commands, from the beginning on."""
    run = RouteRun(taught.route, settings, replace(SCENARIO.servo, **servo), way=0.0)
    base = SCENARIO.base.base(taught.stations[0], seed=6)
    simulator = CameraSimulator(SCENARIO.seeded(5).camera)
    for k in range(count):
        twist = run.step(simulator.capture(base.pose, k), base.now_ns).twist
        base.command(Command(twist))
        base.advance(base.now_ns + period_ns(SCENARIO.camera.frame_rate))
        yield run, twist


@pytest.mark.parametrize(
    ('servo', 'settings', 'limit'),
    [
        ({'max_linear': 0.1}, SETTINGS, 0.1),
        ({'max_speed_ratio': 0.2}, SETTINGS, 0.2 * SCENARIO.servo.max_linear),
        ({}, replace(SETTINGS, max_speed=0.1), 0.1),
    ],
)
def test_the_lowest_limit_of_speed_holds_on_the_way(taught, servo, settings, limit) -> None:
    speeds = [twist.linear for _, twist in commands(taught, settings, 15, **servo)]
    assert max(speeds) == pytest.approx(limit)


def test_a_speed_within_the_dead_band_is_driven_by_pulses(taught: Taught) -> None:
    slow = replace(SETTINGS, max_speed=0.04)
    twists = [twist for _, twist in commands(taught, slow, 80, dead_band_linear=0.06)]
    speeds = np.array([twist.linear for twist in twists])
    assert set(np.round(speeds, 9)) == {0.0, 0.06}
    assert speeds[20:].mean() == pytest.approx(0.04, rel=0.2)


@pytest.mark.parametrize(
    ('changed', 'servo'), few_of([({'max_speed': 0.1}, {}), ({}, {'max_speed_ratio': 0.2})])
)
def test_a_limit_lowered_on_the_way_holds_from_the_next_image_on(taught, changed, servo) -> None:
    speeds, offsets = [], []
    for k, (run, twist) in enumerate(commands(taught, SETTINGS, 45)):
        speeds.append(twist.linear)
        if run.last.progress is not None:
            offsets.append(run.last.progress.lateral)
        if k == 30:
            settings = FollowSettings(reverse=True, **changed)  # which is not for this run
            run.use(settings, replace(SCENARIO.servo, **servo))
    assert speeds[30] > 0.4 and max(speeds[31:]) == pytest.approx(0.1)
    assert not run.settings.reverse and np.abs(offsets).max() < 0.01


@pytest.mark.parametrize('moved', few_of([0.15, 0.0]))
def test_a_station_whose_photograph_was_moved_is_no_arrival(taught, moved, monkeypatch) -> None:
    """As by a cabinet that fills it: the servo ends where the photograph looks reached."""
    station = taught.stations[len(taught.route.views) - 1]
    photograph = CameraSimulator(SCENARIO.camera).capture(replace(station, x=station.x + moved), 0)
    show = lambda docking, _: docking._tracker.set_desired(photograph)  # noqa: E731
    monkeypatch.setattr(Docking, 'aim', show)
    log = repeat(SCENARIO.seeded(3), taught, SETTINGS, start=replace(station, x=station.x - 0.6))
    assert (log.outcome == 'arrived') is (moved == 0.0), log.reason
    assert moved == 0.0 or 'from where the way leads' in log.reason


def test_a_robot_off_the_route_stands_and_reports_it(taught: Taught) -> None:
    elsewhere = replace(taught.stations[0], x=12.0, y=5.0)
    settings = replace(SETTINGS, lost_timeout=1.0)
    moved = []

    def watch(image: Image, pose: Pose, step: RouteStep) -> None:
        moved.append(pose != elsewhere)

    log = repeat(SCENARIO.seeded(7), taught, settings, start=elsewhere, watch=watch)
    assert log.outcome == 'failed' and log.reason
    assert not any(moved)


@pytest.mark.long
def test_a_way_that_closes_is_driven_in_laps() -> None:
    taught = teach(SCENARIO, way_named('loop'))
    log = repeat(SCENARIO.seeded(4), taught, replace(SETTINGS, laps=2))
    assert log.outcome == 'arrived', log.reason
    first, second = log.laps()
    assert np.abs(np.concatenate([first, second])).max() < 0.015
    assert log.station[0] < 3e-3


@pytest.mark.long
def test_where_a_way_closes_both_of_its_ends_are_one_place() -> None:
    """It is found there, and drives the whole lap; before the end it drives to the end."""
    taught = teach(SCENARIO, way_named('loop'))
    start = taught.stations[0]
    for ahead, length in ((0.3, 11.0), (-0.6, 0.5)):
        beside = Pose(start.x + ahead, start.y + 0.1, start.theta + 0.1)
        log = repeat(SCENARIO.seeded(4), taught, SETTINGS, start=beside)
        assert log.outcome == 'arrived', log.reason
        assert length < log.length < length + 3.0


def test_a_lap_begins_in_the_half_of_the_route_where_the_way_begins(taught, monkeypatch) -> None:
    looked: list[range | None] = []

    def find(finder: PlaceFinder, image: Image, among: range | None = None) -> None:
        looked.append(among)

    monkeypatch.setattr(PlaceFinder, 'find', find)
    count, image = len(taught.route.views), taught.route.views[0].image
    for reverse, half in ((False, range((count + 1) // 2)), (True, range(count // 2, count))):
        run = RouteRun(taught.route, FollowSettings(laps=2, reverse=reverse), SCENARIO.servo)
        run.step(image, 0)
        run._begin_lap(10**9)
        assert run.step(image, 2 * 10**9).phase == 'localizing'
        assert looked[-2:] == [None, half]


def test_a_lap_whose_beginning_is_not_in_sight_fails_with_what_a_lap_needs(taught: Taught) -> None:
    settings = FollowSettings(laps=2)
    run = RouteRun(taught.route, settings, SCENARIO.servo)
    run._begin_lap(0)
    elsewhere = np.zeros_like(taught.route.views[0].image)
    late_ns = round(1.1e9 * settings.lost_timeout)
    step = run.step(elsewhere, late_ns)
    assert step.phase == 'failed'
    assert 'lap 2 needs a way that ends in sight of its beginning' in step.reason


@pytest.mark.long
@pytest.mark.parametrize('turn', [0.5 * np.pi, -2.0])
def test_a_turn_on_the_spot_is_taught_and_repeated_standing(turn: float) -> None:
    """By key views that share the turn, and by the odometry where it is too far for that."""
    corner = np.array([3.0, -4.7, 0.5 * np.pi])
    legs = [corner - [0.0, 0.045 * k, 0.0] for k in range(30, -1, -1)]
    legs += [corner + [0.0, 0.0, turn * k / 20] for k in range(1, 21)]
    x, y = np.cos(legs[-1][2]), np.sin(legs[-1][2])
    legs += [legs[-1] + [0.045 * k * x, 0.045 * k * y, 0.0] for k in range(1, 31)]
    poses = [Pose(*leg.tolist()) for leg in legs]
    teacher, world = Teacher(SCENARIO.camera.nominal_camera), CameraSimulator(SCENARIO.camera)
    for k, pose in enumerate(poses):
        teacher.add(world.capture(pose, k), k * 90_000_000, pose)
    route = teacher.finish()
    assert any(view.bridge is not None for view in route.views) is (turn < -1.9)
    way = DrivenWay(np.array([[pose.x, pose.y] for pose in [*poses[:31], *poses[51:]]]))
    stations = {0: poses[0], len(route.views) - 1: poses[-1]}
    log = repeat(SCENARIO, Taught(route, way, stations), SETTINGS)
    assert log.outcome == 'arrived' and log.station[0] < 3e-3 and not log.standstills
    assert any(sample.twist.linear == 0.0 and sample.twist.angular for sample in log.samples)


PANORAMA = CameraSettings(width=640, height=320, distortion_model='equirectangular')
WIDE = route_scenario(Scenario(camera=PANORAMA).with_servo({'law': 'smooth'}), 1)
TURNED = Pose(3.15, -3.6, -1.1)  # 0.15 m beside the way, 153 deg off its heading


@pytest.fixture(scope='module')
def taught_wide() -> Taught:
    return teach(WIDE, rounded(((3.0, -3.9), (3.0, -3.1), (3.0, -2.4))))


def test_it_is_found_at_any_heading(taught_wide: Taught) -> None:
    found = kidnap(WIDE, taught_wide, 3, 1)
    assert (found.right, found.wrong) == (3, 0)


def test_its_lens_is_not_learnt_as_its_width_is_360_deg(taught_wide: Taught) -> None:
    lenses = [view.structure.shared[2] for view in taught_wide.route.views]
    assert np.abs(lenses).max() < 1e-3


def test_it_turns_to_the_way_where_it_stands(taught_wide: Taught) -> None:
    simulator = CameraSimulator(WIDE.camera)
    run = RouteRun(taught_wide.route, FollowSettings(), WIDE.servo)
    steps = [run.step(simulator.capture(TURNED, k), round(k * 9e7)) for k in range(3)]
    assert steps[1].twist == STANDSTILL  # it begins with the ramp of the base
    assert steps[-1].progress is not None and steps[-1].progress.inliers > 20, steps[-1]
    assert math.degrees(steps[-1].progress.turn) == pytest.approx(-153.0, abs=1.0)
    assert steps[-1].twist.angular > 0.0 and not any(step.twist.linear for step in steps)


def test_a_base_that_steers_does_not_turn_and_fails_with_the_reason(taught_wide: Taught) -> None:
    car = ServoSettings(law='smooth', base='car', max_curvature=1.6)
    run = RouteRun(taught_wide.route, FollowSettings(), car)
    step = run.step(CameraSimulator(WIDE.camera).capture(TURNED, 0), 0)
    assert step.phase == 'failed' and 'does not turn in place' in step.reason


@pytest.mark.long
def test_a_way_is_repeated_from_where_it_faces_back(taught_wide: Taught) -> None:
    log = repeat(WIDE.seeded(5), taught_wide, FollowSettings(), start=TURNED)
    assert log.outcome == 'arrived', log.reason
    assert log.station[0] < 3e-3 and not log.is_wrong


def test_a_camera_on_a_head_is_refused_in_one_line() -> None:
    scenario = load(None, Path(__file__).parents[3] / 'config/rigs/pan.yaml')
    with pytest.raises(InputError, match='fixed to the base, got rig pan_tilt'):
        route_scenario(scenario, 1)
