"""Rooms and storeys: what is painted, furnished, lit and seen through doors."""

import math

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.light import CEILING, LIGHTS, UNCHANGED
from visual_servo_epipolar.simulation.rendering.raster import PinholeView, rasterize
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import Scene, Surface, Texture
from visual_servo_epipolar.simulation.rigs import SimulatedRig
from visual_servo_epipolar.simulation.rooms.building import Builder
from visual_servo_epipolar.simulation.rooms.scene import room
from visual_servo_epipolar.simulation.rooms.storey import (
    CELLS,
    changed,
    storey_builder,
    storey_look,
)
from visual_servo_epipolar.simulation.routes import way_named, WAYS

CAMERA = Camera(1280, 1024, 769.0, 769.0, 635.0, 512.0)
SEEDS = (0, 1)


@pytest.fixture(scope='module')
def rooms() -> dict[int, Scene]:
    return {seed: room(seed) for seed in SEEDS}


def keypoint_places(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels of what SIFT finds from the goal, and the world points there."""
    renderer = Renderer(scene, SimulatedRig(CAMERA))
    keypoints = cv2.SIFT_create().detect(renderer.render(DESIRED_POSE), None)
    pixels = np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64)
    return pixels, renderer.trace(pixels, DESIRED_POSE)


def test_the_same_seed_gives_the_same_wall_and_the_last_one_is_kept() -> None:
    first = room(3, 'wall')
    assert room(3, kind='wall') is first
    room(4, 'wall')  # one room is kept: the next is built anew
    second = room(3, 'wall')
    assert second is not first
    for one, other in zip(first.surfaces, second.surfaces, strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.texture.image, other.texture.image)


def test_another_seed_gives_another_room(rooms: dict[int, Scene]) -> None:
    assert not np.allclose(rooms[0].corners, rooms[1].corners)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(
        ValueError, match="room, wall, plain, nearwall, nearwall_boxes, got 'cave'"
    ):
        room(0, 'cave')


@pytest.mark.parametrize('seed', SEEDS)
def test_the_way_of_the_robot_is_free(rooms: dict[int, Scene], seed: int) -> None:
    scene = rooms[seed]
    corners = scene.corners[scene.bodies > 0]
    low = corners[corners[:, :, 2].min(axis=1) < 2.0]
    near = low[low[:, :, 1].min(axis=1) < 3.2]
    assert (np.abs(near[:, :, 0]).min(axis=1) > 2.6).all()


@pytest.mark.parametrize('seed', SEEDS)
def test_every_two_bodies_are_on_either_side_of_a_face(rooms: dict[int, Scene], seed: int) -> None:
    scene = rooms[seed]
    offsets = np.einsum('ij,ij->i', scene.normals, scene.corners[:, 0])
    count = int(scene.bodies.max()) + 1
    parted = np.eye(count, dtype=bool)
    for k in range(1, count):
        corners = scene.corners[scene.bodies == k].reshape(-1, 3)
        outside = (corners @ scene.normals.T - offsets).min(axis=0) > -1e-6
        parted[k, scene.bodies[outside]] = True
    assert (parted | parted.T)[1:, 1:].all()


@pytest.mark.parametrize('seed', SEEDS)
def test_the_goal_sees_features_at_many_depths(rooms: dict[int, Scene], seed: int) -> None:
    _, points = keypoint_places(rooms[seed])
    depths = points[:, 1]
    share_of_back_wall = np.mean(depths > 7.99)
    bands = np.histogram(depths, bins=(3.0, 4.0, 5.0, 6.0, 8.0))[0]
    assert len(points) > 1000
    assert share_of_back_wall < 0.3
    assert (bands > 0.05 * len(points)).all()


@pytest.mark.parametrize('seed', SEEDS)
def test_the_goal_sees_features_in_every_part_of_the_image(rooms, seed) -> None:
    pixels, _ = keypoint_places(rooms[seed])
    counts, _, _ = np.histogram2d(*pixels.T, bins=(4, 3), range=((0, 1280), (0, 1024)))
    assert (counts > 20).all()


def test_most_features_of_the_wall_lie_on_the_wall() -> None:
    _, points = keypoint_places(room(0, 'wall'))
    assert len(points) > 1000
    assert np.mean(np.abs(points[:, 1] - 5.0) < 1e-6) > 0.7


def test_a_surface_must_be_a_rectangle() -> None:
    texture = Texture(np.zeros((4, 4), dtype=np.uint8))
    edges = np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 1.0])
    with pytest.raises(ValueError, match='edges of wall must be at right angles'):
        Surface('wall', 'room', np.zeros(3), *edges, texture)


def test_a_scene_without_surfaces_is_refused() -> None:
    with pytest.raises(ValueError, match='at least one surface'):
        Scene(())


def test_a_near_wall_is_a_dock_of_one_plane_and_boxes_stand_before_it() -> None:
    _, points = keypoint_places(room(0, 'nearwall'))
    np.testing.assert_allclose(points[:, 1], 0.7, atol=1e-6)
    _, points = keypoint_places(room(0, 'nearwall_boxes'))
    before = points[:, 1] < 0.69
    assert points[before, 1].min() > 0.3
    assert 0.05 < before.mean() < 0.6


IN_ROOM = (
    DESIRED_POSE,
    Pose(0.63, -1.21, math.radians(97.0)),
    Pose(-1.2, -4.0, math.radians(65.0)),
    Pose(0.3, 0.9, math.radians(111.0)),
    Pose(0.3, -10.0, math.radians(90.0)),
)
IN_STOREY = (
    Pose(3.0, -7.4, math.pi / 2.0),
    Pose(3.0, -2.4, 0.5 * math.pi),
    Pose(0.0, -1.2, 0.0),
    Pose(9.5, 3.0, 2.0),
    Pose(-1.2, 5.0, math.pi / 2.0),
    Pose(15.2, 10.2, math.pi),
)
MIDDLE = Camera(640, 480, 385.0, 385.0, 317.5, 240.0)
SMALL = Camera(320, 240, 193.0, 193.0, 159.5, 119.5)


@pytest.fixture(scope='module')
def storey() -> Builder:
    return storey_builder(1)


def test_a_third_of_the_pictures_is_exchanged_where_they_hung(storey: Builder) -> None:
    before = [panel for panel in storey.panels if panel.sheet.pictures]
    names = {panel.name: panel for panel in changed(storey, 1).panels}
    others = [len(names[one.name].sheet.pictures) - len(one.sheet.pictures) for one in before]
    total = sum(len(one.sheet.pictures) for one in before)
    assert 0.25 * total < sum(others) < 0.42 * total


@pytest.mark.parametrize('seed', range(3))
def test_furniture_that_is_moved_leaves_the_ways_free(storey: Builder, seed: int) -> None:
    standing = changed(storey, seed).standing
    low = [piece for piece in standing if piece.bottom < 1.0]
    moved = [piece for piece in low if piece not in storey.standing]
    assert sum('chair' in piece.name for piece in moved) == 2 * len(CELLS) < len(moved)
    points = np.concatenate([way_named(name).points for name in WAYS])
    points = np.column_stack([points, np.zeros(len(points))])
    assert min(float(piece.distances(points).min()) for piece in moved) > 0.2


def test_lamps_of_another_seed_are_others(storey: Builder) -> None:
    first, second, again = (changed(storey, seed) for seed in (1, 2, 1))
    assert first.sources == again.sources != second.sources
    assert len(first.lamps) < len(storey.lamps)


@pytest.mark.parametrize(
    ('camera', 'pose'),
    [*((MIDDLE, pose) for pose in IN_ROOM), *((SMALL, pose) for pose in IN_STOREY)],
)
def test_of_all_surfaces_the_nearest_is_drawn(rooms, storey, camera: Camera, pose: Pose) -> None:
    scene, off = rooms[0], 1e-6
    if camera is SMALL:
        scene, off = storey_look(storey, LIGHTS[CEILING], UNCHANGED), 0.02
    rig, size = SimulatedRig(camera), (camera.width, camera.height)
    axes, centre = rig.camera_pose(pose)
    raster = rasterize(scene, PinholeView(*size, camera.matrix, centre, axes))
    u, v = (np.random.default_rng(0).uniform(2.0, each - 3.0, 400).round() for each in size)
    points = Renderer(scene, rig).trace(np.stack([u, v], axis=1), pose)
    numbers = raster.ids[v.astype(int), u.astype(int)]
    drawn = [raster.strips[number - 1].surface for number in numbers]
    away = np.abs(((points - scene.corners[drawn, 0]) * scene.normals[drawn]).sum(axis=1))
    # A pixel on an edge may show either side of it.
    assert np.mean(away < off) > 0.98
