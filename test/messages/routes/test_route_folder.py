"""The folder of a route: what is read is what was written, or one clear error."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from routes import CAMERA, key_view, route_of

from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, with_intrinsics
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.route import Appearance, in_memory, Route
from visual_servo_epipolar.messages.routes.route_folder import read_route, write_route


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_route(route_of(*map(key_view, range(3))), tmp_path / 'hall')
    return tmp_path / 'hall'


def test_a_route_is_read_as_it_was_written(folder: Path) -> None:
    route = read_route(folder)
    assert route.camera == CAMERA and route.stations == [2]
    for number, view in enumerate(route.views):
        expected = key_view(number)
        off = np.abs(view.image.astype(int) - expected.image)
        assert not off.any() if view.is_station else 0 < off.max() < 60
        assert np.array_equal(view.keypoints.descriptors, expected.keypoints.descriptors)
        assert np.array_equal(view.structure.pixels, expected.structure.pixels)
        assert np.array_equal(view.structure.inverse_depth, expected.structure.inverse_depth)
        assert np.array_equal(view.path.poses, expected.path.poses)
        assert view.keypoints.tuning == 2 and view.way == expected.way
    assert sorted(file.name for file in folder.iterdir()) == [
        '000000.jpg',
        '000001.jpg',
        '000002.png',
        'camera.yaml',
        'route.yaml',
        'structure.npz',
    ]


def test_photographs_of_other_days_are_kept_and_lose_nothing(folder: Path) -> None:
    route, rows = read_route(folder), np.array([1, 4])
    old = (folder / '000001.jpg').read_bytes()
    for number, count in ((1, 2), (2, 1)):
        view = route.views[number]
        looks = [
            Appearance(in_memory(key_view(10 + k).image), view.keypoints.take(rows), rows)
            for k in range(count)
        ]
        views = list(route.views)
        views[number] = replace(view, renewed=tuple(looks))
        route = replace(route, views=tuple(views))
    write_route(route, folder)
    again = read_route(folder)
    assert [len(view.renewed) for view in again.views] == [0, 2, 1]
    assert (folder / '000001.jpg').read_bytes() == old
    assert np.array_equal(again.views[2].renewed[0].load(), key_view(10).image)
    assert np.array_equal(again.views[1].renewed[1].rows, rows)
    expected = key_view(1).keypoints.descriptors[rows]
    assert np.array_equal(again.views[1].renewed[0].keypoints.descriptors, expected)
    (folder / '000002_1.png').unlink()
    with pytest.raises(InputError, match='1 of 6 photographs are missing, the first is 000002_1'):
        read_route(folder)


@pytest.mark.parametrize(
    ('name', 'match'),
    [
        ('route.yaml', 'route.yaml cannot be read'),
        ('camera.yaml', 'camera.yaml'),
        ('structure.npz', 'structure.npz is missing, cut off or damaged'),
    ],
)
def test_a_file_that_is_cut_off_is_named(folder: Path, name: str, match: str) -> None:
    data = (folder / name).read_bytes()
    (folder / name).write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=match):
        read_route(folder)


def test_a_photograph_that_is_missing_is_named(folder: Path) -> None:
    (folder / '000001.jpg').unlink()
    with pytest.raises(
        InputError, match='1 of 3 photographs are missing, the first is 000001.jpg'
    ):
        read_route(folder)


def test_a_photograph_that_is_cut_off_is_named_when_it_is_needed(folder: Path) -> None:
    data = (folder / '000001.jpg').read_bytes()
    (folder / '000001.jpg').write_bytes(data[:200])
    route = read_route(folder)
    with pytest.raises(InputError, match='000001.jpg: the photograph cannot be read'):
        _ = route.views[1].image


def test_a_calibration_that_was_changed_is_refused(folder: Path) -> None:
    text = (folder / 'camera.yaml').read_text().replace('- 50.0', '- 51.0', 1)
    (folder / 'camera.yaml').write_text(text)
    with pytest.raises(InputError, match='its hash differs'):
        read_route(folder)


def test_another_camera_or_resolution_is_refused(folder: Path) -> None:
    route = read_route(folder)
    with pytest.raises(InputError, match='another camera: fx 50 -> 60, fy 50 -> 60, rays up to'):
        route.check_camera(with_intrinsics(CAMERA, fx=60.0, fy=60.0, cx=31.5, cy=23.5))
    large = (100.0, 0.0, 63.5, 0.0, 100.0, 47.5, 0.0, 0.0, 1.0)
    with pytest.raises(InputError, match='taught at 64x48, the camera gives 128x96'):
        route.check_camera(calibrated_camera((128, 96), large, (), 'plumb_bob'))


@pytest.mark.parametrize('changes', [{'fx': 50.000005}, {'cx': 32.0, 'fy': 50.2}])
def test_a_camera_that_was_calibrated_anew_sees_the_learnt_rays(folder: Path, changes) -> None:
    route, camera = read_route(folder), with_intrinsics(CAMERA, **changes)
    seen = route.seen_by(camera)
    for view, before in zip(seen.views, route.views, strict=True):
        rays = CAMERA.rays(before.structure.pixels)
        np.testing.assert_allclose(camera.rays(view.structure.pixels), rays, atol=1e-9)
        assert view.keypoints is before.keypoints
    assert route.seen_by(CAMERA) is route


def test_a_panorama_cut_off_its_middle_comes_back(tmp_path: Path) -> None:
    panorama = with_intrinsics(of_size(64, 32), height=20, cy=13.0)
    write_route(Route(panorama, tuple(map(key_view, range(3)))), tmp_path / 'cut')
    assert read_route(tmp_path / 'cut').camera == panorama


def test_a_disk_that_is_full_leaves_the_earlier_route(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {file.name: file.read_bytes() for file in folder.iterdir()}

    def full(*_: object, **__: object) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(np, 'savez_compressed', full)
    with pytest.raises(InputError, match='No space left on device'):
        write_route(route_of(*map(key_view, range(2))), folder)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    assert list(folder.parent.iterdir()) == [folder]


def test_a_folder_of_something_else_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / 'thesis.tex').write_text('years of work')
    with pytest.raises(InputError, match='holds something else'):
        write_route(route_of(*map(key_view, range(2))), tmp_path)
    assert (tmp_path / 'thesis.tex').exists()


def test_a_folder_without_a_route_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='no folder of a route'):
        read_route(tmp_path)
