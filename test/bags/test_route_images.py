"""Images along a recorded way: each with where the base was, by odometry or by commands."""

import json
from pathlib import Path

from bagmaker import Message, write_bag
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from recorded_drives import befallen, Change, REFUSED, room_drive, TAKEN

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.route_images import RecordedWay
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, with_intrinsics
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.route_folder import read_route

CAMERA = calibrated_camera((64, 48), (50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0), ())
STAMPED = '/stamped/cmd_vel'
BY_COMMANDS = 'no odometry: the way is that of'
ODOMETRY = '/odom', '/other/odom', '/odometry/filtered', '/robot_1/odom', '/robot_2/odom'
KINDS = dict.fromkeys(ODOMETRY, 'nav_msgs/msg/Odometry') | {
    '/robot_1/image_raw': 'sensor_msgs/msg/Image',
    '/robot_1/camera_info': 'sensor_msgs/msg/CameraInfo',
    STAMPED: 'geometry_msgs/msg/TwistStamped',
}
SECOND = 10**9
WAYS = pytest.approx([0.4, 0.6, 0.8, 1.0])


def calibrations(*cameras: CameraModel) -> list[Message]:
    told = [write.camera_info(camera, k, 'c') for k, camera in enumerate(cameras)]
    return [('/camera_info', k, bytes(serialize_message(info))) for k, info in enumerate(told)]


def views(frame: str = 'c', rows: int = 48, begin_ns: int = SECOND) -> list[Message]:
    rng, messages = np.random.default_rng(1), []
    for k in range(4):
        stamp = begin_ns + k * SECOND // 2
        image = write.image(rng.integers(0, 255, (rows, 64), np.uint8), 'mono8', stamp, frame)
        messages.append(('/image_raw', stamp, bytes(serialize_message(image))))
    return messages


def images() -> list[Message]:
    return calibrations(CAMERA) + views()


def odometry(topic: str) -> list[Message]:
    messages = []
    for k in range(4):
        pose = Pose(0.4 * k, 0.0, 0.1 * k)
        message = write.odometry(pose, STANDSTILL, k * SECOND, 'odom', 'base_link')
        messages.append((topic, k * SECOND, bytes(serialize_message(message))))
    return messages


def commands(topic: str = '/cmd_vel', late: int = 0) -> list[Message]:
    """Return commands that come ``late`` [s] after their stamps, if the topic has such."""
    messages, is_stamped = [], topic != '/cmd_vel'
    for k in range(12):
        stamp_ns = k * SECOND // 4
        message = write.command(Twist(0.5, 0.0), stamp_ns, 'base_link', stamped=is_stamped)
        messages.append((topic, stamp_ns + late * SECOND, bytes(serialize_message(message))))
    return messages


def bag_of(folder: Path, *parts: list[Message]) -> Path:
    messages = sorted((message for part in parts for message in part), key=lambda it: it[1])
    return write_bag(folder / 'bag', messages, kinds=KINDS)


def test_poses_are_those_at_the_stamps_of_the_images(tmp_path: Path) -> None:
    with Bag(bag_of(tmp_path, images(), odometry('/odom'))) as bag:
        way = RecordedWay(bag, {})
        taken = [(stamp_ns, pose.x, pose.theta) for _, stamp_ns, pose in way.images()]
    assert way.camera == CAMERA and not way.notes
    assert [stamp for stamp, _, _ in taken] == [SECOND + k * SECOND // 2 for k in range(4)]
    assert [x for _, x, _ in taken] == pytest.approx([0.4, 0.6, 0.8, 1.0])
    assert [theta for _, _, theta in taken] == pytest.approx([0.1, 0.15, 0.2, 0.25])


@pytest.mark.parametrize(
    ('motion', 'ways', 'notes'),
    [
        (commands(), [0.5, 0.75, 1.0, 1.25], [f'{BY_COMMANDS} /cmd_vel']),
        (
            commands(STAMPED, 1),
            [0.5, 0.75, 1.0, 1.25],
            [f'no odometry: the way is that of {STAMPED}'],
        ),
        (odometry('/odometry/filtered') + commands(), [0.4, 0.6, 0.8, 1.0], []),
    ],
    ids=['commands', 'stamped commands', 'odometry, by its type'],
)
def test_the_way_is_that_of_odometry_or_of_the_commands(tmp_path, motion, ways, notes) -> None:
    with Bag(bag_of(tmp_path, images(), motion)) as bag:
        way = RecordedWay(bag, {})
        assert [pose.x for _, _, pose in way.images()] == pytest.approx(ways)
    assert way.notes == notes


def without_orientation() -> list[Message]:
    message = Odometry()
    message.pose.pose.orientation.w = 0.0
    return [('/odom', k, bytes(serialize_message(message))) for k in range(2)]


@pytest.mark.parametrize(
    ('motion', 'words'),
    [
        ([], 'nothing tells how far the robot drove'),
        (without_orientation(), 'must be a quaternion of length 1, got length 0'),
        (odometry('/odom') + odometry('/other/odom'), 'say --odometry NAME'),
    ],
)
def test_a_bag_whose_way_is_unknown_is_refused(tmp_path, motion, words) -> None:
    with Bag(bag_of(tmp_path, images(), motion)) as bag:
        with pytest.raises(InputError, match=words):
            RecordedWay(bag, {})
        if '/other/odom' in bag.topics:
            assert len(list(RecordedWay(bag, {}, odometry='/other/odom').images())) == 4


def test_odometry_beside_the_images_is_that_of_their_robot(tmp_path: Path) -> None:
    own = [(f'/robot_1{topic}', *rest) for topic, *rest in images() + odometry('/odom')]
    other = [(topic, 0, raw) for topic, _, raw in odometry('/robot_2/odom')]
    with Bag(bag_of(tmp_path, own, other)) as bag:
        way = RecordedWay(bag, {})
        assert [pose.x for _, _, pose in way.images()] == WAYS
    words = 'of /robot_1/odom, /robot_2/odom the odometry beside the images is /robot_1/odom'
    assert way.notes == [words]


@pytest.mark.parametrize(
    ('apart', 'words'),
    [
        (100, '/cmd_vel is 99.00 s newer than the image, stamped 100.00 s and 1.00 s; let one'),
        (-100, '/cmd_vel is 98.25 s older than the image, stamped 2.75 s and 101.00 s; let one'),
    ],
)
def test_commands_of_another_clock_are_named(tmp_path: Path, apart: int, words: str) -> None:
    begin_ns = (max(-apart, 0) + 1) * SECOND
    parts = calibrations(CAMERA), views(begin_ns=begin_ns), commands(late=max(apart, 0))
    with Bag(bag_of(tmp_path, *parts)) as bag, pytest.raises(InputError, match=words):
        list(RecordedWay(bag, {}).images())


@pytest.mark.parametrize('factor', [1.0000001, 1.2])
def test_a_camera_info_that_changes_is_refused_as_in_the_node(tmp_path, factor: float) -> None:
    other = with_intrinsics(CAMERA, fx=50.0 * factor)
    parts = calibrations(CAMERA, CAMERA, other), views(), odometry('/odom')
    with Bag(bag_of(tmp_path, *parts)) as bag:
        change = f'has changed while recording: fx 50 -> {50.0 * factor:.8g}, rays up to'
        with pytest.raises(InputError, match=change):
            RecordedWay(bag, {})
        assert RecordedWay(bag, {}, camera=CAMERA).camera == CAMERA


@pytest.mark.parametrize('rows', [32, 20])
def test_a_panorama_without_camera_info_has_a_projection(tmp_path: Path, rows: int) -> None:
    with Bag(bag_of(tmp_path, views(rows=rows), odometry('/odom'))) as bag:
        with pytest.raises(InputError, match='no camera_info; .* or say --projection'):
            RecordedWay(bag, {})
        way = RecordedWay(bag, {}, projection='equirectangular')
        assert way.camera == of_size(64, rows)
        assert [' 64x20 px are taken for panoramas' in note for note in way.notes] == (
            [True] if rows == 20 else []
        )


def test_one_beside_its_images_of_another_frame_is_noted_as_by_a_node(tmp_path: Path) -> None:
    with Bag(bag_of(tmp_path, views(frame='a'), calibrations(CAMERA), odometry('/odom'))) as bag:
        note = "/image_raw and /camera_info may be of two cameras, of the frames 'a' and 'c'"
        assert RecordedWay(bag, {}).notes == [note]


def recorded(folder: Path, change: Change) -> Path:
    """Write a bag of a drive that something befell."""
    drive = befallen(change)
    begin = drive.images[0]
    info = write.camera_info(drive.camera, begin.stamp_ns, 'c')
    messages = [('/camera_info', begin.came_ns, bytes(serialize_message(info)))]
    for seen in drive.images:
        image = write.image(seen.image, 'mono8', seen.stamp_ns, 'c')
        messages.append(('/image_raw', seen.came_ns, bytes(serialize_message(image))))
    for told in drive.odometry:
        odom = write.odometry(told.pose, STANDSTILL, told.stamp_ns, told.frame, 'base_link')
        messages.append(('/odom', told.came_ns, bytes(serialize_message(odom))))
    return bag_of(folder, messages)


@pytest.mark.parametrize('name', REFUSED)
def test_no_route_comes_of(name: str, tmp_path: Path) -> None:
    change, words = REFUSED[name]
    with Bag(recorded(tmp_path, change)) as bag, pytest.raises(InputError) as error:
        list(RecordedWay(bag, {}).images())
    assert words in str(error.value)


@pytest.mark.parametrize('name', TAKEN)
def test_a_route_comes_all_the_same_of(name: str, tmp_path: Path) -> None:
    change, length, note = TAKEN[name]
    with Bag(recorded(tmp_path, change)) as bag:
        way = RecordedWay(bag, {})
        ways = [pose.x for _, _, pose in way.images()]
    assert max(ways) - ways[0] == pytest.approx(length, abs=0.03)
    assert way.notes == [note] * bool(note)


def test_a_way_is_written_or_refused_whole(tmp_path, capsys) -> None:
    out = tmp_path / 'out'
    bag = recorded(tmp_path, TAKEN['odometry begins late'][0])
    assert main(['route', 'teach', str(bag), '--out', str(out), '--json', '-']) == 0
    result, route = json.loads(capsys.readouterr().out), read_route(out)
    assert result['length_m'] == pytest.approx(1.25, abs=0.01) == route.length
    assert route.camera == room_drive().camera and route.stations == [0, len(route.views) - 1]
    assert result['key_views'] == len(route.views)
    assert '15 images are left out' in result['notes'][0] and len(result['notes']) == 2
    bag = recorded(tmp_path / 'other', REFUSED['odometry ends early'][0])
    assert main(['route', 'teach', str(bag), '--out', str(tmp_path / 'none')]) == 2
    assert 'the last 23 of 45 images have no place' in capsys.readouterr().err
    assert not (tmp_path / 'none').exists()
