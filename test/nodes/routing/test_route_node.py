"""The route node: what may go wrong ends in one clear message and a robot that stands."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from nav_msgs.msg import Path as PathMessage
import numpy as np
import pytest
from rclpy.logging import get_logger
from rclpy.qos import DurabilityPolicy, QoSProfile
from recorded_drives import befallen, RecordedDrive, REFUSED, room_drive, TAKEN
from route_rig import RouteRig
from routes import CAMERA, key_view, route_of, SIZE
from std_msgs.msg import Bool

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.registry import with_intrinsics
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.routes.route import Appearance, in_memory, Route
from visual_servo_epipolar.core.routes.run import FOLLOWING, RouteRun, RouteStep
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.messages.route_folder import read_route, write_route
from visual_servo_epipolar.nodes.route_runs import RouteRenewal

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DRIVES = RouteStep(Twist(0.4, 0.1), FOLLOWING)


def picture(number: int) -> Image:
    return np.random.default_rng(number).integers(0, 255, SIZE[::-1], np.uint8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_route(route_of(*map(key_view, range(3))), tmp_path / 'hall')
    return tmp_path / 'hall'


OTHER = with_intrinsics(CAMERA, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
ANEW = with_intrinsics(CAMERA, fx=50.000005)


@pytest.fixture
def rig(bench, folder) -> RouteRig:
    return RouteRig(bench, folder, CAMERA)


@pytest.fixture
def driving(rig, monkeypatch) -> RouteRig:
    """Return a rig whose robot is told to drive by each image."""

    def step(run: RouteRun, image: Image, stamp_ns: int) -> RouteStep:
        if not run.ended:
            run.last, run._newest_ns = DRIVES, stamp_ns
        return run.last

    monkeypatch.setattr(RouteRun, 'step', step)
    rig.see(picture(0))
    assert rig.call('repeat')[0]
    for k in range(1, 4):
        rig.see(picture(k))
    rig.bench.until(lambda: not rig.stands, 'the robot to drive')
    return rig


def test_a_panorama_needs_no_camera_info_and_what_its_size_does_not_tell_is_logged(
    bench, folder
) -> None:
    rig = RouteRig(bench, folder.parent / 'new', None, projection='equirectangular')
    rig.see(picture(0)[:, :100])
    success, why = rig.call('start_recording')
    assert not success and 'whose size tells the camera' in why
    rig.see(np.zeros((48, 96), np.uint8))
    assert rig.call('start_recording')[0]
    assert not bench.logged('rows cut above')
    rig = RouteRig(bench, folder.parent / 'cut', None, projection='equirectangular')
    rig.see(np.zeros((30, 96), np.uint8))
    bench.until(lambda: bool(bench.logged('with as many rows cut above as below')), 'the note')


def test_a_camera_info_that_changes_while_recording_is_refused_with_its_numbers(rig) -> None:
    rig.see(picture(0))
    assert rig.call('start_recording')[0]
    rig.calibrate(ANEW)
    success, text = rig.call('stop_recording')
    assert not success and 'has changed while recording: fx 50 -> 50.000005' in text


def test_the_base_is_commanded_nothing_before_a_request(rig) -> None:
    for k in range(3):
        rig.see(picture(k))
    rig.bench.settle()
    assert not rig.commands and rig.node.phase == 'waiting'


def test_a_late_subscriber_receives_the_route(rig) -> None:
    paths = rig.bench.listen(PathMessage, '/route_node/path', LATCHED)
    rig.bench.until(lambda: bool(paths), 'the path')
    assert paths[0].header.frame_id == 'route' and len(paths[0].poses) > 10


def test_a_robot_that_is_not_on_the_route_stands_and_fails_with_a_reason(bench, folder) -> None:
    rig = RouteRig(bench, folder, CAMERA, lost_timeout=1.0)
    rig.see(picture(0))
    assert rig.call('repeat')[0]
    for k in range(1, 16):
        rig.see(picture(k))
    assert rig.node.phase == 'failed' and 'features in common' in rig.reason
    assert rig.stands
    level = rig.diagnoses[-1].status[0].level
    rig.bench.settle()
    assert level == rig.diagnoses[-1].status[0].level == b'\x02'


def test_a_robot_whose_images_stop_stands(driving) -> None:
    driving.bench.until(lambda: driving.node.phase == 'holding', 'the watch to see it')
    driving.bench.until(lambda: driving.stands, 'the order to stand')
    assert 'no new images for 0.' in driving.reason
    driving.see(picture(9))
    driving.bench.until(lambda: not driving.stands, 'the robot to go on')


def test_a_step_that_took_too_long_is_not_driven_by(driving, clock, monkeypatch) -> None:
    step = RouteRun.step

    def slow(run: RouteRun, image: Image, stamp_ns: int) -> RouteStep:
        clock.go_on(1.0)
        return step(run, image, stamp_ns)

    monkeypatch.setattr(RouteRun, 'step', slow)
    driving.bench.settle()
    told = len(driving.commands)
    driving.node._repetition.see(picture(9), driving.stamp_ns + 1, 'camera', 0.0)
    driving.bench.until(lambda: len(driving.commands) > told, 'a command')
    assert driving.stands and 'took 1.00 s, too long to drive by it' in driving.reason


def hang(rig: RouteRig) -> None:
    for _ in range(9):
        rig.see(picture(3))


@pytest.mark.parametrize(
    ('befalls', 'phase', 'words'),
    [
        (lambda rig: rig.see(picture(9), rig.stamp_ns), 'holding', 'stamps do not advance'),
        (lambda rig: rig.see(picture(9), rig.stamp_ns - 3 * 10**9), 'holding', 'then ~/repeat'),
        (hang, 'holding', 'the very same'),
        (lambda rig: rig.see(picture(9)[::2, ::2]), 'holding', 'image has 32x24 px'),
        (lambda rig: rig.calibrate(OTHER), 'failed', 'taught with another camera'),
        (lambda rig: rig.calibrate(ANEW), 'failed', 'changed in mid-run: fx 50 -> 50.000005'),
    ],
    ids=['old stamp', 'clock set back', 'camera hangs', 'other size', 'other camera', 'anew'],
)
def test_a_robot_stands_where_an_image_or_its_camera_is_wrong(
    driving, befalls, phase, words
) -> None:
    befalls(driving)
    driving.bench.until(lambda: driving.stands, 'the order to stand')
    assert driving.node.phase == phase and words in driving.reason


def test_a_stop_button_stops_and_keeps_from_starting(driving) -> None:
    press = driving.bench.talk(Bool, 'stop_button')
    press(Bool(data=True))
    driving.bench.until(lambda: driving.stands, 'the order to stand')
    driving.see(picture(9))
    assert driving.stands and driving.node.phase == 'waiting'
    assert driving.bench.logged('release it, then call ~/repeat')
    text = 'the stop button is pressed; release it, then call ~/repeat'
    assert driving.call('repeat') == (False, text)


def test_a_repetition_that_is_cancelled_stands(driving) -> None:
    assert driving.call('cancel') == (True, 'the robot stands')
    driving.see(picture(9))
    driving.bench.settle()
    assert driving.stands and driving.node.phase == 'waiting'


def test_a_node_that_ends_tells_the_base_to_stand(driving) -> None:
    driving.node.stop()
    driving.bench.until(lambda: driving.stands, 'the order to stand')


@pytest.mark.parametrize(
    ('camera', 'values', 'success', 'words'),
    [
        (CAMERA, {'enable_timeout': 5.0}, False, 'no message has come on /enable yet'),
        (OTHER, {}, False, 'taught with another camera'),
        (ANEW, {}, True, 'the camera was calibrated anew: fx 50 -> 50.000005'),
        (CAMERA, {'station': 4}, False, 'station must be one of 0 to 0'),
    ],
)
def test_what_keeps_a_robot_from_repeating_is_said(
    bench, folder, camera, values, success, words
) -> None:
    rig = RouteRig(bench, folder, camera, **values)
    rig.see(picture(0))
    answer, text = rig.call('repeat')
    assert answer is success and words in text


def test_a_folder_that_is_not_whole_is_refused(rig, folder) -> None:
    (folder / 'structure.npz').unlink()
    rig.see(picture(0))
    success, text = rig.call('repeat')
    assert not success and 'missing, cut off or damaged' in text
    rig.see(picture(1))
    assert not rig.commands


def test_a_photograph_that_cannot_be_read_on_the_way_ends_the_run(rig, folder) -> None:
    rig.see(picture(0))
    assert rig.call('repeat')[0]
    (folder / '000001.webp').write_bytes(b'nothing')
    # What is in view is the key view whose photograph is broken.
    assert not rig.stands or rig.node.phase in ('waiting', 'localizing')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            'visual_servo_epipolar.core.routes.places.PlaceFinder.votes',
            lambda finder, image, among: np.array([0.0, 50.0, 0.0]),
        )
        rig.see(picture(1))
    assert rig.node.phase == 'failed' and 'cannot be read' in rig.reason and rig.stands


def test_another_folder_is_refused_before_the_way_is_driven(bench, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'mine').mkdir()
    (tmp_path / 'mine' / 'thesis.tex').touch()
    rig = RouteRig(bench, tmp_path, CAMERA, route='~/mine')
    rig.see(picture(0))
    success, text = rig.call('start_recording')
    assert not success and 'mine must be a new folder' in text and 'thesis.tex' in text


def test_without_a_folder_nothing_begins(bench, tmp_path) -> None:
    rig = RouteRig(bench, tmp_path, CAMERA, route='')
    rig.see(picture(0))
    for service in ('repeat', 'start_recording'):
        success, text = rig.call(service)
        assert not success and 'names no folder; set it: ros2 param set /route_node route' in text


def test_without_images_nothing_begins(rig, clock) -> None:
    clock.go_on(2.0)
    success, text = rig.call('repeat')
    assert not success and 'no images have come' in text


def test_a_service_out_of_turn_says_what_to_call(rig) -> None:
    rig.see(picture(0))
    for service in ('station', 'stop_recording'):
        text = 'no way is being recorded; call ~/start_recording first'
        assert rig.call(service) == (False, text)
    assert rig.call('start_recording')[0]
    for service in ('start_recording', 'repeat'):
        success, text = rig.call(service)
        assert not success and '~/stop_recording it first' in text


def full(*_: object, **__: object) -> None:
    raise OSError(28, 'No space left on device')


def test_what_a_full_disk_keeps_from_being_written_is_not_lost(rig, folder, monkeypatch) -> None:
    before = (folder / 'route.yaml').read_text()
    rig.node._taught = route_of(*map(key_view, range(2)))
    with monkeypatch.context() as patch:
        patch.setattr(Path, 'write_text', full)
        success, text = rig.call('stop_recording')
    assert not success and 'No space left on device' in text
    assert (folder / 'route.yaml').read_text() == before
    success, text = rig.call('stop_recording')
    assert success and '2 key views, written to' in text


def test_a_recording_without_odometry_says_so(rig) -> None:
    rig.see(picture(0))
    assert rig.call('start_recording')[0]
    for k in range(1, 63):
        rig.see(picture(k))
    success, text = rig.call('stop_recording')
    assert not success and 'nothing usable came on /odom yet' in text


def test_a_head_that_may_turn_is_refused(bench, folder) -> None:
    with pytest.raises(ValueError, match='routes must have a camera that is fixed to the base'):
        RouteRig(bench, folder, CAMERA, rig='pan_tilt')


RUPTURED = 'odometry is reset', 'two frames'


@pytest.mark.parametrize(
    'name', [*RUPTURED, 'backward', 'one that hangs for a while', 'a bag in a loop']
)
def test_no_route_comes_of(bench, tmp_path: Path, name: str) -> None:
    change, words = REFUSED[name]
    rig = RouteRig(bench, tmp_path / 'hall', room_drive().camera)
    rig.see(room_drive().images[0].image)
    success, text = rig.record(befallen(change))
    assert not success and words in text
    assert ('look at what publishes it: /probe' in text) is (name in RUPTURED)
    assert not (tmp_path / 'hall').exists()


def test_a_station_without_odometry_names_both_clocks(rig) -> None:
    rig.see(picture(0), 7 * 10**9)
    assert rig.call('start_recording')[0]
    rig.tell(RecordedDrive(CAMERA, [], room_drive().odometry[:1]))
    rig.see(picture(1), 8 * 10**9)
    success, text = rig.call('station')
    assert not success
    words = '/odom is 1699999992.00 s newer than the image, stamped 1700000000.00 s and 8.00 s'
    assert words in text


@pytest.mark.parametrize('name', ['images out of order', 'each image twice'])
def test_a_route_comes_all_the_same_of(bench, tmp_path: Path, name: str) -> None:
    change, length, note = TAKEN[name]
    rig = RouteRig(bench, tmp_path / 'hall', room_drive().camera)
    rig.see(room_drive().images[0].image)
    success, text = rig.record(befallen(change))
    assert success and text.startswith(f'{length:.2f} m') and text.endswith(f'; {note}')
    assert read_route(tmp_path / 'hall').length == pytest.approx(length, abs=0.01)


def after_arrival(folder: Path, renew: int) -> None:
    route = read_route(folder)
    view, rows = route.views[1], np.arange(4)
    look = Appearance(in_memory(key_view(7).image), view.keypoints.take(rows), rows)
    views = (route.views[0], replace(view, renewed=(look,)), route.views[2])

    def renewed() -> Route:
        return replace(route, views=views)

    run = SimpleNamespace(settings=FollowSettings(renewals=renew), confirmed=1, renewed=renewed)
    renewal = RouteRenewal(get_logger('test'))
    renewal.follow(run, folder)  # type: ignore[arg-type]
    renewal.begin()
    renewal.begin()  # by the next image
    renewal.wait()


@pytest.mark.parametrize('renew', [0, 2])
def test_photographs_of_today_are_written_where_that_is_wanted(folder: Path, renew: int) -> None:
    after_arrival(folder, renew)
    assert [len(view.renewed) for view in read_route(folder).views] == [0, int(renew > 0), 0]


def test_a_full_disk_leaves_the_route_as_it_was(folder: Path, monkeypatch) -> None:
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    monkeypatch.setattr(Path, 'write_text', full)
    after_arrival(folder, 2)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
