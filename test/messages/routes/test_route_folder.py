"""The folder of a route: what is read is what was written, or one clear error."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
import os
from pathlib import Path
import signal
import sys
from zipfile import ZIP_LZMA, ZipFile

import numpy as np
import pytest
from routes import CAMERA, key_view, route_of

from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, with_intrinsics
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.route import Appearance, Bridge, in_memory, Route
from visual_servo_epipolar.files import PARTIAL
from visual_servo_epipolar.messages.route_folder import check_folder, read_route, write_route

NAMES = 'route.yaml', 'camera.yaml', 'structure.npz', '000001.webp'
STEPS = {'open', 'os.mkdir', 'os.rename', 'os.remove', 'os.rmdir', 'os.chmod'}


LONGER = with_intrinsics(CAMERA, fx=60.0, fy=60.0, cx=31.5, cy=23.5)


def routed(*numbers: int) -> Route:
    return route_of(*map(key_view, numbers))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_route(routed(0, 1, 2), tmp_path / 'hall')
    return tmp_path / 'hall'


def test_a_route_is_read_as_it_was_written_and_loses_nothing_more(folder: Path, tmp_path) -> None:
    route = read_route(folder)
    assert route.camera == CAMERA and route.stations == [2]
    for number, view in enumerate(route.views):
        expected = key_view(number)
        off = np.abs(view.image.astype(int) - expected.image)
        assert not off.any() if view.is_station else 0 < off.max() < 60
        kept, learnt = view.structure, expected.structure
        assert np.abs(view.keypoints.descriptors - expected.keypoints.descriptors).max() <= 8.0
        assert np.allclose(kept.pixels, learnt.pixels, rtol=0.0, atol=2.0**-5)
        assert np.allclose(kept.inverse_depth, learnt.inverse_depth, rtol=2.0**-12)
        assert np.allclose(view.path.poses, expected.path.poses, rtol=0.0, atol=2.0**-17)
        assert view.keypoints.tuning == 2 and view.way == expected.way
    assert {file.name for file in folder.iterdir()} == {*NAMES, '000000.webp', '000002.webp'}
    bridge = Bridge(0.36, -1.5, 0.004, 0.02)
    views = route.views[0], replace(route.views[1], bridge=bridge), route.views[2]
    write_route(route_of(*views), tmp_path / 'again')
    for file in (it for it in folder.iterdir() if it.name != 'route.yaml'):
        assert (tmp_path / 'again' / file.name).read_bytes() == file.read_bytes()
    again = read_route(tmp_path / 'again')
    assert [view.bridge for view in again.views] == [None, bridge, None]


def test_descriptors_take_a_byte_where_that_holds_them(tmp_path: Path) -> None:
    view = key_view(0)
    for largest, size in ((240.0, 1), (512.0, 2)):
        descriptors = np.full_like(view.keypoints.descriptors, largest)
        keypoints = replace(view.keypoints, descriptors=descriptors)
        other = replace(view, keypoints=keypoints)
        write_route(route_of(other, key_view(1)), tmp_path / f'{size}')
        with np.load(tmp_path / f'{size}' / 'structure.npz') as stored:
            assert stored['descriptors'].itemsize == size
            assert stored['covariance'].dtype == np.float32
        again = read_route(tmp_path / f'{size}').views[0]
        assert np.allclose(again.structure.covariance, view.structure.covariance, rtol=2.0**-8)


def test_photographs_of_other_days_are_kept_and_lose_nothing(folder: Path) -> None:
    route, rows = read_route(folder), np.array([1, 4])
    old = (folder / '000001.webp').read_bytes()
    for number, days in ((1, 2), (2, 1)):
        view = route.views[number]
        looks = [
            Appearance(in_memory(key_view(10 + k).image), view.keypoints.take(rows), rows)
            for k in range(days)
        ]
        views = list(route.views)
        views[number] = replace(view, renewed=tuple(looks))
        route = replace(route, views=tuple(views))
    write_route(route, folder)
    again = read_route(folder)
    assert [len(view.renewed) for view in again.views] == [0, 2, 1]
    assert (folder / '000001.webp').read_bytes() == old
    assert np.array_equal(again.views[2].renewed[0].load(), key_view(10).image)
    assert np.array_equal(again.views[1].renewed[1].rows, rows)
    expected = route.views[1].keypoints.descriptors[rows]
    assert np.array_equal(again.views[1].renewed[0].keypoints.descriptors, expected)
    (folder / '000002_1.webp').unlink()
    with pytest.raises(InputError, match='1 of 6 photographs are missing, the first is 000002_1'):
        read_route(folder)


def without_hashes(folder: Path) -> None:
    """Make it a folder as earlier versions wrote it."""
    text = (folder / 'route.yaml').read_text()
    begin, end = text.index('sha256:'), text.index('views:')
    (folder / 'route.yaml').write_text(text[:begin] + text[end:])


def packed_by_lzma(folder: Path) -> None:
    """Pack the structure as 1.0.0 did."""
    without_hashes(folder)
    with np.load(folder / 'structure.npz') as file:
        arrays = dict(file)
    with ZipFile(folder / 'structure.npz', 'w', ZIP_LZMA) as packed:
        for name, array in arrays.items():
            with packed.open(f'{name}.npy', 'w') as part:
                np.save(part, array)


Damage = Callable[[bytes], bytes]


def flipped(place: float) -> Damage:
    """Return what makes 16 bytes wrong, at the end those of the directory."""

    def flip(data: bytes) -> bytes:
        begin = int(place * len(data)) if place < 1.0 else data.rindex(b'PK\x01\x02') + 8
        wrong = bytes(0xFF - each for each in data[begin : begin + 16])
        return data[:begin] + wrong + data[begin + 16 :]

    return flip


def appended(value: str) -> Damage:
    return lambda data: data + f'a: {value}\n'.encode()


def halved(data: bytes) -> bytes:
    return data[: len(data) // 2]


DAMAGED = 'structure.npz is missing, cut off or damaged'
DAMAGES = [
    (None, 'route.yaml', halved, 'route.yaml cannot be read'),
    (None, 'camera.yaml', halved, 'camera.yaml'),
    (None, 'structure.npz', halved, DAMAGED),
    (None, '000001.webp', halved, '000001.webp: the photograph cannot be read'),
    (without_hashes, '000001.webp', lambda data: data[:200], '000001.webp: the photograph cannot'),
    *(
        (None, name, appended(value), f'{name} cannot be read')
        for name in ('route.yaml', 'camera.yaml')
        for value in ('2020-13-45', '!!int x', '!!timestamp x')
    ),
    *(
        (earlier, 'structure.npz', flipped(place), DAMAGED)
        for earlier in (without_hashes, packed_by_lzma)
        for place in (0.1, 0.3, 0.5, 0.7, 1.0)
    ),
]


@pytest.mark.parametrize(('earlier', 'name', 'damage', 'words'), DAMAGES)
def test_a_damaged_file_is_named(folder: Path, earlier, name: str, damage, words: str) -> None:
    if earlier is not None:
        earlier(folder)
    (folder / name).write_bytes(damage((folder / name).read_bytes()))
    with pytest.raises(InputError, match=words):
        _ = read_route(folder).views[1].image


@pytest.mark.parametrize('name', NAMES)
def test_a_part_of_another_route_is_refused(folder: Path, tmp_path: Path, name: str) -> None:
    write_route(replace(routed(0, 3, 4), camera=LONGER), tmp_path / 'other')
    (folder / name).write_bytes((tmp_path / 'other' / name).read_bytes())
    with pytest.raises(InputError, match='hash'):
        read_route(folder)


def test_a_folder_of_an_earlier_version_is_read_and_gets_hashes_when_it_is_written(folder) -> None:
    route = read_route(folder)
    packed_by_lzma(folder)
    earlier = read_route(folder)
    assert np.array_equal(earlier.views[1].image, route.views[1].image)
    kept, expected = earlier.views[1].structure, route.views[1].structure
    assert np.array_equal(kept.inverse_depth, expected.inverse_depth)
    write_route(earlier, folder)
    assert 'sha256:' in (folder / 'route.yaml').read_text()
    assert np.array_equal(read_route(folder).views[1].image, route.views[1].image)


def test_a_kill_at_any_moment_leaves_one_route_and_the_files_of_the_user(folder: Path) -> None:
    routes = [routed(0, 1, 2), routed(1, 2)]
    own = {folder / 'notes.txt': b'turn left', folder / '.git' / 'HEAD': b'ref'}
    (folder / '.git').mkdir()
    for path, content in own.items():
        path.write_bytes(content)
    for step in count():
        child = os.fork()
        if not child:
            kill_at(step)
            write_route(routes[1], folder)
            os._exit(0)
        is_killed = os.WIFSIGNALED(os.waitpid(child, 0)[1])
        found = read_route(folder)
        (expected,) = (route for route in routes if len(route.views) == len(found.views))
        for view, before in zip(found.views, expected.views, strict=True):
            assert np.abs(view.image.astype(int) - before.image).max() < 60
            assert np.allclose(view.structure.pixels, before.structure.pixels, 0.0, 0.05)
        write_route(routes[0], folder)
        assert {path: path.read_bytes() for path in own} == own
        others = '.git', '000000.webp', '000002.webp', 'notes.txt'
        assert {item.name for item in folder.iterdir()} == {*NAMES, *others}
        if not is_killed:
            break
    assert step > 15 and len(found.views) == 2


def kill_at(step: int) -> None:
    """Kill this process at that step among those that change files."""
    steps = count()

    def see(event: str, _: object) -> None:
        if event in STEPS and next(steps) == step:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(see)


def test_a_route_that_is_damaged_or_was_never_whole_can_be_taught_anew(folder, tmp_path) -> None:
    (folder / 'route.yaml').write_text('version: 1')
    (folder / 'notes.txt').touch()
    write_route(routed(0, 1), folder)
    assert len(read_route(folder).views) == 2 and (folder / 'notes.txt').exists()
    assert not (folder / '000002.webp').exists()
    (tmp_path / 'new' / f'{PARTIAL}x').mkdir(parents=True)
    (tmp_path / 'new' / f'{PARTIAL}x' / '000000.webp').touch()
    write_route(routed(0, 1), tmp_path / 'new')
    assert not list((tmp_path / 'new').glob('.*'))


def test_a_file_of_the_user_is_not_replaced_by_a_photograph(folder: Path) -> None:
    (folder / '000003.webp').write_text('my own')
    with pytest.raises(InputError, match='000003.webp is no part of the route there'):
        write_route(routed(0, 1, 2, 3), folder)
    assert (folder / '000003.webp').read_text() == 'my own' and len(read_route(folder).views) == 3
    write_route(routed(0, 1), folder)
    assert (folder / '000003.webp').read_text() == 'my own'
    assert not (folder / '000002.webp').exists()


@pytest.mark.parametrize('is_there', [True, False])
def test_a_link_is_followed(folder: Path, tmp_path: Path, is_there: bool) -> None:
    target, link = tmp_path / 'disk' / 'target', tmp_path / 'link'
    link.symlink_to(target)
    if is_there:
        target.mkdir(parents=True)
    check_folder(link)
    write_route(routed(0, 1), link)
    write_route(read_route(folder), link)
    assert link.is_symlink() and len(read_route(target).views) == 3


def test_another_camera_or_resolution_is_refused(folder: Path) -> None:
    route = read_route(folder)
    with pytest.raises(InputError, match='another camera: fx 50 -> 60, fy 50 -> 60, rays up to'):
        route.check_camera(LONGER)
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


WRITERS = check_folder, partial(write_route, routed(0, 1))


@pytest.mark.parametrize('write', WRITERS, ids=['check', 'write'])
def test_what_is_no_folder_of_a_route_is_refused(tmp_path: Path, write) -> None:
    (tmp_path / 'thesis.tex').write_text('years of work')
    with pytest.raises(InputError, match='holds something else'):
        write(tmp_path)
    with pytest.raises(InputError, match='Not a directory; name another folder'):
        write(tmp_path / 'thesis.tex' / 'hall')
    with pytest.raises(InputError, match='no folder of a route'):
        read_route(tmp_path)
    assert (tmp_path / 'thesis.tex').read_text() == 'years of work'
