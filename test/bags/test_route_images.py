"""Images along a recorded way: each with where the base was, by odometry or by commands."""

from pathlib import Path

from bagmaker import Message, write_bag
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.route_images import RecordedWay
from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import calibrated_camera, with_intrinsics
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.messages import write

CAMERA = calibrated_camera((64, 48), (50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0), ())
COLOR, DEPTH = '/cam/color/image_raw', '/cam/depth/camera_info'
TOLD = 'may be of two cameras'  # as the nodes log it
KINDS = {
    '/odom': 'nav_msgs/msg/Odometry',
    '/other/odom': 'nav_msgs/msg/Odometry',
    COLOR: 'sensor_msgs/msg/Image',
    DEPTH: 'sensor_msgs/msg/CameraInfo',
}
SECOND = 10**9


def calibrations(*cameras: CameraModel, topic: str = '/camera_info', frame: str = 'c'):
    told = [write.camera_info(camera, k, frame) for k, camera in enumerate(cameras)]
    return [(topic, k, bytes(serialize_message(info))) for k, info in enumerate(told)]


def views(topic: str = '/image_raw', frame: str = 'c', rows: int = 48) -> list[Message]:
    rng, messages = np.random.default_rng(1), []
    for k in range(4):
        stamp = SECOND + k * SECOND // 2
        image = write.image(rng.integers(0, 255, (rows, 64), np.uint8), 'mono8', stamp, frame)
        messages.append((topic, stamp, bytes(serialize_message(image))))
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


def commands() -> list[Message]:
    step = SECOND // 4
    drive = bytes(serialize_message(write.twist(Twist(0.5, 0.0))))
    return [('/cmd_vel', k * step, drive) for k in range(12)]


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


def test_without_odometry_the_way_is_that_of_the_commands(tmp_path: Path) -> None:
    with Bag(bag_of(tmp_path, images(), commands())) as bag:
        way = RecordedWay(bag, {})
        ways = [pose.x for _, _, pose in way.images()]
    assert ways == pytest.approx([0.5, 0.75, 1.0, 1.25])
    assert 'no odometry' in way.notes[0]


def test_a_bag_that_does_not_tell_how_far_it_went_is_refused(tmp_path: Path) -> None:
    with (
        Bag(bag_of(tmp_path, images())) as bag,
        pytest.raises(InputError, match='nothing tells how far the robot drove'),
    ):
        RecordedWay(bag, {})


def test_two_odometries_are_a_choice(tmp_path: Path) -> None:
    parts = images(), odometry('/odom'), odometry('/other/odom')
    with Bag(bag_of(tmp_path, *parts)) as bag:
        with pytest.raises(InputError, match='say --odometry NAME'):
            RecordedWay(bag, {})
        assert len(list(RecordedWay(bag, {}, odometry='/other/odom').images())) == 4


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


@pytest.mark.parametrize(
    ('frames', 'words'),
    [
        (('c', 'c'), f'{DEPTH} is taken for {COLOR}, by their frame_id alone'),
        (('c', ''), f'{COLOR} and {DEPTH} {TOLD}, in two namespaces, and no frame_id tells'),
        (('', ''), f'{COLOR} and {DEPTH} {TOLD}, in two namespaces, and no frame_id tells'),
    ],
)
def test_the_camera_info_of_another_namespace_is_noted(tmp_path, frames, words) -> None:
    calibration = calibrations(CAMERA, topic=DEPTH, frame=frames[1])
    parts = views(COLOR, frames[0]), calibration, odometry('/odom')
    with Bag(bag_of(tmp_path, *parts)) as bag:
        assert RecordedWay(bag, {}).notes == [words]
        assert RecordedWay(bag, {'camera_info': DEPTH}).notes == []


def test_the_camera_info_of_another_frame_too_must_be_named(tmp_path: Path) -> None:
    parts = views(COLOR, 'a'), calibrations(CAMERA, topic=DEPTH, frame='b'), odometry('/odom')
    with Bag(bag_of(tmp_path, *parts)) as bag:
        with pytest.raises(InputError, match=f'say which: --topics camera_info={DEPTH}'):
            RecordedWay(bag, {})
        assert RecordedWay(bag, {'camera_info': DEPTH}).camera == CAMERA


def test_one_beside_its_images_of_another_frame_is_noted_as_by_a_node(tmp_path: Path) -> None:
    with Bag(bag_of(tmp_path, views(frame='a'), calibrations(CAMERA), odometry('/odom'))) as bag:
        note = f'/image_raw and /camera_info {TOLD}, of the frames a and c'
        assert RecordedWay(bag, {}).notes == [note]
