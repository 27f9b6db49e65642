"""Images along a recorded way: each with where the base was, by odometry or by commands."""

from pathlib import Path

from bagmaker import Message, write_bag
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.route_images import RecordedWay
from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.messages import write

CAMERA = calibrated_camera((64, 48), (50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0), ())
KINDS = {'/odom': 'nav_msgs/msg/Odometry', '/other/odom': 'nav_msgs/msg/Odometry'}
SECOND = 10**9


def images() -> list[Message]:
    rng = np.random.default_rng(1)
    messages = [('/camera_info', 0, bytes(serialize_message(write.camera_info(CAMERA, 0, 'c'))))]
    for k in range(4):
        stamp = SECOND + k * SECOND // 2
        image = write.image(rng.integers(0, 255, (48, 64), np.uint8), 'mono8', stamp, 'c')
        messages.append(('/image_raw', stamp, bytes(serialize_message(image))))
    return messages


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
