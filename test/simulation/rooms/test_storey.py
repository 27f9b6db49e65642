"""The storey: what is seen through its doors, and that nearer walls hide what is behind them."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.light import (
    CEILING,
    FURNITURE,
    LIGHTS,
    PICTURES,
    RoomChange,
    STOREY,
)
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.rendering.raster import PinholeView, rasterize
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rooms.storey import (
    changed_storey,
    ChangedStorey,
    PLAN,
    Storey,
    StoreyScene,
)
from visual_servo_epipolar.simulation.routes import way_named, WAYS

POSES = (
    Pose(3.0, -7.4, math.pi / 2.0),
    Pose(3.0, -2.4, 0.5 * math.pi),
    Pose(0.0, -1.2, 0.0),
    Pose(9.5, 3.0, 2.0),
    Pose(-1.2, 5.0, math.pi / 2.0),
    Pose(15.2, 10.2, math.pi),
)
CAMERA = CameraSettings(
    width=320, height=240, focal_length=193.0, principal_u=159.5, principal_v=119.5
)


@pytest.fixture(scope='module')
def storey() -> Storey:
    return Storey(1)


@pytest.fixture(scope='module')
def scene(storey: Storey) -> StoreyScene:
    return storey.by(CEILING)


def changed(storey: Storey, name: str, seed: int = 1) -> ChangedStorey:
    change = RoomChange(name, True, seed)
    return changed_storey(storey._builder, storey._cells, LIGHTS[CEILING], change)


def test_a_third_of_the_pictures_is_exchanged_where_they_hung(storey: Storey) -> None:
    before, after = storey._builder.panels, changed(storey, PICTURES).builder.panels
    hung = [k for k, panel in enumerate(before) if panel.sheet.pictures]
    others = [len(after[k].sheet.pictures) - len(before[k].sheet.pictures) for k in hung]
    total = sum(len(before[k].sheet.pictures) for k in hung)
    assert 0.25 * total < sum(others) < 0.42 * total
    assert all(one.frame is other.frame for one, other in zip(before, after, strict=True))


@pytest.mark.parametrize('seed', range(3))
def test_furniture_that_is_moved_leaves_the_ways_free(storey: Storey, seed: int) -> None:
    standing = changed(storey, FURNITURE, seed).builder.standing
    low = [piece for piece in standing if piece.bottom < 1.0]
    moved = [piece for piece in low if piece not in storey._builder.standing]
    assert sum('chair' in piece.name for piece in moved) == 2 * len(PLAN.cells) < len(moved)
    points = np.concatenate([way_named(name).points for name in WAYS])
    points = np.column_stack([points, np.zeros(len(points))])
    assert min(float(piece.distances(points).min()) for piece in moved) > 0.2


def test_lamps_of_another_seed_are_others(storey: Storey) -> None:
    first, second, again = (changed(storey, STOREY, seed) for seed in (1, 2, 1))
    assert first.sources == again.sources != second.sources
    assert len(first.builder.lamps) < len(storey._builder.lamps)
    points = np.array([[[3.0, -6.0, 0.0]]])
    up, lamps = np.array([0.0, 0.0, 1.0]), first.builder.places_of_lamps
    lit = [
        each._light_in(frozenset(['office'])).on(points, up, lamps, []) for each in (first, second)
    ]
    assert lit[0] != lit[1]


def test_a_room_without_a_door_in_line_is_not_seen() -> None:
    seen = PLAN.seen_from(0.5, -7.9)  # a corner of the office, whose door leads to the corridor
    assert {'office', 'south', 'store'} <= seen
    assert not seen & {'north', 'east', 'west'}


def test_in_a_door_both_sides_are_seen() -> None:
    assert {'office', 'south'} <= PLAN.seen_from(3.0, -2.4)


def test_every_opening_joins_two_cells() -> None:
    assert len(PLAN.openings) == sum(len(wall.openings) for wall in PLAN.walls)


@pytest.mark.parametrize('pose', POSES)
def test_of_all_surfaces_the_nearest_is_drawn(scene: StoreyScene, pose: Pose) -> None:
    rig = new_rig(CAMERA)
    axes, centre = rig.camera_pose(pose)
    view = PinholeView(CAMERA.width, CAMERA.height, rig.camera.matrix, centre, axes)
    part = scene.seen_from(centre)
    raster = rasterize(part, view)
    u, v = (np.random.default_rng(0).uniform(2.0, size - 3.0, 400).round() for size in (320, 240))
    points = Renderer(scene, rig).trace(np.stack([u, v], axis=1), pose)
    numbers = raster.ids[v.astype(int), u.astype(int)]
    drawn = [raster.strips[number - 1].surface for number in numbers]
    away = [
        abs(float((point - part.corners[k, 0]) @ part.normals[k]))
        for k, point in zip(drawn, points, strict=True)
    ]
    # A pixel on an edge may show either side of it.
    assert np.mean(np.array(away) < 0.02) > 0.98
