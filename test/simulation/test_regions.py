"""Regions of starts, and the ground plan that keeps the way free."""

from collections.abc import Callable
from dataclasses import replace
import math
from pathlib import Path

from durations import few_of
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import CAMERA

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, HALF_PI, Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.regions import (
    CLEARANCE,
    depths,
    Ground,
    LEAST_FEATURES,
    REGIONS,
    Start,
    start_in,
)
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig
from visual_servo_epipolar.simulation.rooms.scene import room
from visual_servo_epipolar.simulation.scenario import from_document, load, Scenario
from visual_servo_epipolar.simulation.views import points_of

SMALL = load(Path(__file__).parents[2] / 'config' / 'scenarios' / 'small.yaml')
BOUNDS = {
    'around': ((-4.0, -4.0, -180.0), (4.0, 4.0, 180.0)),
    'front': ((-1.5, -5.0, -15.0), (1.5, -2.0, 15.0)),
    'beside': ((-1.5, -2.0, -15.0), (1.5, 1.5, 15.0)),
    'anywhere': ((-6.0, -10.0, -180.0), (6.0, 4.0, 180.0)),
}
FEW_POINTS = replace(Scenario().points, candidates=LEAST_FEATURES - 1)
regions = st.sampled_from([*REGIONS])
seeds = st.integers(0, 2**31 - 1)
indices = st.integers(0, 10**6)


@given(regions, seeds, indices)
def test_a_start_lies_in_its_region(region: str, seed: int, index: int) -> None:
    low, high = BOUNDS[region]
    start = np.array(start_in(region, seed, index, Scenario()))
    assert (low <= start).all() and (start <= high).all()
    assert [float(f'{value:.6f}') for value in start] == start.tolist()  # as it is written down


@given(regions, seeds, indices, indices)
def test_seed_and_index_alone_decide(region: str, seed: int, index: int, other: int) -> None:
    start = start_in(region, seed, index, Scenario())
    elsewhere = start_in(region, seed, other, Scenario())
    assert start_in(region, seed, index, Scenario()) == start
    assert (elsewhere == start) == (other == index)
    assert start_in(region, seed + 1, index, Scenario()) != start


@pytest.mark.parametrize('region', few_of(['front', 'beside']))
def test_a_box_is_filled_evenly(region: str) -> None:
    low, high = map(np.array, BOUNDS[region])
    starts = np.array([start_in(region, 0, index, Scenario()) for index in range(2000)])
    shares = (starts - low) / (high - low)
    # Of 2000 uniform numbers the mean is known to 0.0065 and the deviation to 0.0031.
    np.testing.assert_allclose(shares.mean(axis=0), 0.5, atol=0.03)
    np.testing.assert_allclose(shares.std(axis=0), math.sqrt(1.0 / 12.0), atol=0.015)


@settings(max_examples=30)
@given(seeds, indices)
def test_anywhere_forty_points_of_the_run_are_in_view(seed: int, index: int) -> None:
    scenario = Scenario().seeded(seed)
    pose = Pose.from_start(*start_in('anywhere', 1, index, scenario))
    world = points_of(scenario, seed)
    assert int(world.project(pose)[1].sum()) >= LEAST_FEATURES
    # 40 of the cloud are at least 40 of those handed on: the floor does not shake, nobody passes.
    assert len(world.observe(pose, 0)) >= LEAST_FEATURES


def test_a_head_may_be_turned_to_see_the_goal() -> None:
    on_a_head = from_document({'camera': {'rig': 'pan_tilt'}}, 'test')
    starts = np.array([start_in('around', 0, index, on_a_head) for index in range(60)])
    fixed = np.array([start_in('around', 0, index, Scenario()) for index in range(60)])
    assert np.abs(starts[:, 2]).max() > 150.0 > 120.0 > np.abs(fixed[:, 2]).max()


def test_anywhere_is_on_every_side_and_at_every_heading_that_shows_the_scene() -> None:
    starts = np.array([start_in('anywhere', 0, index, Scenario()) for index in range(300)])
    x, y, heading = starts.T
    assert x.min() < -5.0 and x.max() > 5.0 and y.min() < -9.0 and y.max() > 2.0
    assert heading.min() < -60.0 and heading.max() > 60.0


def room_starts(region: str, count: int) -> list[Start]:
    return [start_in(region, 0, index, SMALL, source='images') for index in range(count)]


def test_in_images_front_and_beside_are_those_of_the_points() -> None:
    # Nothing stands where these regions are: the two sources can be compared start by start.
    for region in ('front', 'beside'):
        expected = [start_in(region, 0, index, SMALL) for index in range(50)]
        assert room_starts(region, 50) == expected


@pytest.fixture(scope='module')
def simulator() -> CameraSimulator:
    return CameraSimulator(SMALL.camera)


def test_in_images_anywhere_is_inside_the_room_and_off_the_furniture(simulator) -> None:
    for start in room_starts('anywhere', 80):
        pose = Pose.from_start(*start)
        # Half a robot's size around it, at the height of its camera, all is air.
        assert away(simulator, pose) > 0.29


def away(simulator: CameraSimulator, pose: Pose) -> float:
    """Return how far the nearest surface is, all around at the height of the camera [m]."""
    camera = simulator.camera
    pixels = np.stack([np.linspace(0.0, camera.width - 1.0, 40), np.full(40, camera.cy)], axis=1)
    nearest = math.inf
    for turn in np.arange(5) * 2.0 * math.pi / 5.0:  # the field of view is 79 deg
        looking = replace(pose, theta=pose.theta + turn)
        met = simulator.renderer.trace(pixels, looking)
        distance = np.linalg.norm(met - simulator.renderer.rig.camera_pose(looking).centre, axis=1)
        nearest = min(nearest, float(distance.min()))
    return nearest


def test_in_images_anywhere_shows_what_the_photograph_shows(simulator: CameraSimulator) -> None:
    # A place of the photograph, seen from the start as it looks at the goal's scene.
    u, v = np.meshgrid(np.linspace(20, 620, 24), np.linspace(20, 460, 16))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    points = simulator.renderer.trace(pixels, DESIRED_POSE)
    for start in room_starts('anywhere', 40):
        visible = simulator.renderer.project(points, Pose.from_start(*start))[1]
        # At least 40 of 240 features; of an even grid perhaps half that share.
        assert visible.mean() > 0.5 * LEAST_FEATURES / SMALL.tracker.candidates


@pytest.mark.parametrize(
    ('draw', 'message'),
    [
        (lambda: start_in('behind', 0, 0, Scenario()), 'region must be one of front, beside, any'),
        (
            lambda: start_in('anywhere', 0, 0, replace(Scenario(), points=FEW_POINTS)),
            'no start found in region anywhere in 5000 tries; see that the scene leaves floor',
        ),
    ],
)
def test_a_region_that_cannot_be_is_refused(draw: Callable[[], Start], message: str) -> None:
    with pytest.raises(InputError, match=message):
        draw()


SQUARE = np.array([[[1.0, 1.0, 0.5], [3.0, 1.0, 0.5], [3.0, 2.0, 0.5], [1.0, 2.0, 0.5]]])


@pytest.fixture(scope='module')
def ground() -> Ground:
    return Ground(room(1), SimulatedRig(CAMERA))


def test_depth_in_a_rectangle_is_the_distance_to_its_edge() -> None:
    places = {(2.0, 1.5): 0.5, (1.0, 1.5): 0.0, (2.0, 5.0): -3.0, (4.0, 3.0): -math.sqrt(2.0)}
    for place, depth in places.items():
        assert depths(place, SQUARE) == [pytest.approx(depth)]


def free(ground: Ground, x: float, y: float) -> bool:
    return ground.is_free(Pose(x, y, HALF_PI))


def test_the_goal_and_the_ways_to_it_are_free(ground: Ground) -> None:
    assert all(free(ground, x, y) for x in (-1.5, 0.0, 1.5) for y in (-5.0, -2.0, 0.0, 1.5))


def test_a_robot_stands_neither_in_furniture_nor_too_near_to_it(ground: Ground) -> None:
    # The chest: its front is 0.85 m wide, 4.4 m ahead of the goal give or take 0.1 m.
    assert not free(ground, -1.15, 4.6)
    assert not free(ground, -1.15, 4.3 - CLEARANCE + 0.15)
    assert free(ground, -1.15, 4.3 - CLEARANCE - 0.15)


def test_a_robot_can_stand_under_what_hangs(ground: Ground) -> None:
    # The banner, 3.9 m ahead, begins 2.15 m above the floor.
    assert free(ground, -0.3, 3.9)


@pytest.mark.parametrize(
    ('x', 'y'), [(-5.4, -6.0), (5.4, -12.0), (0.0, -12.9), (0.0, 7.95), (-7.0, 0.0), (0.0, 30.0)]
)
def test_walls_keep_a_robot_in(ground: Ground, x: float, y: float) -> None:
    assert not free(ground, x, y)


def test_the_camera_must_not_be_in_the_wall_either() -> None:
    wall = room(1, 'wall')
    near = Pose(0.0, 4.4, HALF_PI)
    assert Ground(wall, SimulatedRig(CAMERA)).is_free(near)
    assert not Ground(wall, SimulatedRig(CAMERA, CameraMount(forward=0.5))).is_free(near)
