"""Bags of others: another robot's names and encodings, other distributions, two robots."""

from contextlib import closing
from pathlib import Path
import sqlite3

from bagmaker import (
    decoded,
    kind_of,
    Message,
    published,
    replayed,
    TOPICS,
    twists,
    TYPES,
    write_bag,
)
import cv2
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin
from sensor_msgs.msg import CompressedImage
import yaml

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.plan import Moment
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.messages import read, write

DRIVER = ('/image_raw', '/camera_info')


@pytest.fixture(scope='module')
def photograph(small_run):
    return read.gray(next(decoded(item) for item in small_run if item[0] == '/desired/image_raw'))


@pytest.fixture(scope='module')
def driver(small_run) -> list[Message]:
    """What a camera driver alone would have recorded of the first steps."""
    return [item for item in small_run if item[0] in DRIVER][:40]


def packed(gray: np.ndarray, stamp_ns: int = 0, suffix: str = '.jpg') -> bytes:
    """Return a serialized CompressedImage."""
    message = CompressedImage(format=f'mono8; {suffix[1:].replace("jpg", "jpeg")} compressed ')
    message.header = write.header(stamp_ns, 'front')
    message.data.frombytes(cv2.imencode(suffix, gray)[1].tobytes())
    return bytes(serialize_message(message))


def compressed(messages: list[Message], topic: str, suffix: str = '.jpg') -> list[Message]:
    """Return what a camera of compressed images on ``topic`` would have sent."""
    made: list[Message] = []
    for item in messages:
        name, log_ns, raw = item
        if name == '/image_raw':
            image = decoded(item)
            raw = packed(read.gray(image), read.stamp_ns(image.header), suffix)
        made.append((topic if name == '/image_raw' else name, log_ns, raw))
    return made


PICTURE, JPEG, GOAL = '/front/picture', '/image_raw/compressed', '/desired/image_raw/compressed'
PICTURES = dict.fromkeys((PICTURE, JPEG, GOAL), 'sensor_msgs/msg/CompressedImage')


def test_compressed_images_give_them_as_well(driver, small_run, photograph, tmp_path) -> None:
    path = write_bag(tmp_path / 'png', compressed(driver, PICTURE, '.png'), kinds=PICTURES)
    for topics in ({}, {'image': PICTURE, 'camera_info': 'camera_info'}):
        steps = replayed(path, topics, desired=photograph).steps
        assert twists(steps) == published(small_run)[: len(steps)]


def test_compressed_images_are_replayed_by_name(driver, small_run, photograph, tmp_path) -> None:
    messages = [(GOAL, 0, packed(photograph)), *compressed(driver, JPEG)]
    steps = replayed(write_bag(tmp_path / 'jpeg', messages, kinds=PICTURES)).steps
    assert len(steps) == 20
    np.testing.assert_allclose(twists(steps), published(small_run)[:20], atol=0.02)
    assert all(step.telemetry['features'] >= 59 for step in steps)  # JPEG may cost one


@pytest.mark.parametrize('transport', ['raw', 'compressed'])
def test_of_two_transports_that_taken_is_replayed(driver, small_run, tmp_path, transport) -> None:
    jpegs = [item for item in compressed(driver, JPEG) if item[0] == JPEG]
    settings = next(decoded(item) for item in small_run if item[0] == '/tracker_node/settings')
    text = settings.data.replace('transport: raw', f'transport: {transport}')
    told: Message = ('/tracker_node/settings', 0, serialize_message(write.text(text)))
    path = write_bag(tmp_path / 'both', [told, *jpegs, *driver], kinds=PICTURES)
    with Bag(path) as bag:
        expected = '/image_raw' if transport == 'raw' else JPEG
        assert assign_roles(bag, {})['image'].name == expected
        assert assign_roles(bag, {'image': 'image_raw'})['image'].name == '/image_raw'


def write_humble(path: Path, messages: list[Message]) -> Path:
    """Write a bag as humble does: sqlite3, no definitions, QoS as text, no hashes."""
    write_bag(path, messages, storage=StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(path / f'{path.name}.db3')) as base:
        for table in ('schema', 'metadata', 'message_definitions'):
            base.execute(f'DROP TABLE {table}')
        base.execute('ALTER TABLE topics DROP COLUMN type_description_hash')
        base.execute("UPDATE topics SET offered_qos_profiles = ''")
        base.commit()
    metadata = path / 'metadata.yaml'
    document = yaml.safe_load(metadata.read_text())
    information = document['rosbag2_bagfile_information']
    information['version'] = 5
    for name in ('custom_data', 'files', 'ros_distro'):
        del information[name]
    for topic in information['topics_with_message_count']:
        topic['topic_metadata']['offered_qos_profiles'] = ''
        del topic['topic_metadata']['type_description_hash']
    metadata.write_text(yaml.safe_dump(document))
    return path


def test_a_bag_of_humble_gives_the_same_commands(small_run, tmp_path) -> None:
    steps = replayed(write_humble(tmp_path / 'humble', small_run)).steps
    assert twists(steps) == published(small_run)[: len(steps)]


def test_stamped_commands_of_others_are_compared(driver, small_run, photograph, tmp_path) -> None:
    stamps = [read.stamp_ns(decoded(item).header) for item in driver if item[0] == '/image_raw']
    sent = zip(stamps, published(small_run), strict=False)
    more = [
        (
            '/base/command',
            10_000 + number,
            serialize_message(
                write.twist_stamped(Twist(linear + (number == 7), angular), stamp_ns, 'base')
            ),
        )
        for number, (stamp_ns, (linear, angular)) in enumerate(sent)
    ]
    kinds = {'/base/command': 'geometry_msgs/msg/TwistStamped'}
    path = write_bag(tmp_path / 'base', [*driver, *more], kinds=kinds)
    _, steps, comparison = replayed(path, {'cmd_vel': '/base/command'}, desired=photograph)
    assert comparison.compared == len(steps)
    assert comparison.differences['linear_m_s'].differing == 1
    assert comparison.divergence is not None
    assert comparison.divergence.stamp_ns == stamps[7]


@pytest.mark.parametrize(
    ('topics', 'reason'),
    [
        ({'image': '/nowhere'}, "no topic '/nowhere'; it has /camera_info, /image_raw"),
        ({'image': '/camera_info'}, 'but /camera_info is sensor_msgs/msg/CameraInfo'),
    ],
)
def test_a_name_that_will_not_do_is_refused(driver, tmp_path, topics, reason) -> None:
    path = write_bag(tmp_path / 'driver', driver)
    with pytest.raises(InputError, match=reason):
        replayed(path, topics)


def test_two_cameras_are_a_choice(driver, tmp_path) -> None:
    both = [(f'/{side}{topic}', log, raw) for side in ('a', 'b') for topic, log, raw in driver]
    kinds = {f'/{side}{topic}': kind_of(topic) for side in ('a', 'b') for topic in DRIVER}
    path = write_bag(tmp_path / 'both', both, kinds=kinds)
    with pytest.raises(InputError, match='image may be /a/image_raw, /b/image_raw; say which'):
        replayed(path)
    with Bag(path) as bag:  # the camera_info beside the image is the one that is meant
        assert assign_roles(bag, {'image': '/b/image_raw'})['camera_info'].name == '/b/camera_info'


@pytest.mark.parametrize(
    ('missing', 'reason'),
    [
        ('/camera_info', 'no camera_info; name its topic'),
        ('/image_raw', 'no images or tracks to replay; it has /camera_info'),
        ('', 'no desired image; give a file'),
    ],
)
def test_what_is_missing_is_named(driver, tmp_path, missing, reason) -> None:
    path = write_bag(tmp_path / 'driver', [item for item in driver if item[0] != missing])
    with pytest.raises(InputError, match=reason):
        replayed(path, desired=Moment(0, since_first=True) if missing == '/camera_info' else None)


def moved(messages: list[Message], namespace: str) -> list[Message]:
    """Return a run without images of a robot in ``namespace``; diagnostics stay where all are."""
    result = []
    for topic, log_ns, raw in messages:
        if topic == '/diagnostics':
            document = decoded((topic, log_ns, raw))
            for status in document.status:
                status.name = namespace + status.name
            result.append((topic, log_ns, bytes(TYPES.serialize_cdr(document, kind_of(topic)))))
        elif 'image_raw' not in topic or 'tracker_node' in topic:
            result.append((namespace + topic, log_ns, raw))
    return result


def test_of_two_robots_the_user_says_which(small_run, tmp_path, capsys) -> None:
    slower = [item for item in small_run if item[0] != '/epipoles']
    both = sorted([*moved(small_run, '/bot1'), *moved(slower, '/bot2')], key=lambda it: it[1])
    kinds = {f'/{name}{topic}': kind_of(topic) for topic in TOPICS for name in ('bot1', 'bot2')}
    path = str(write_bag(tmp_path / 'two', both, kinds=kinds))
    assert main(['replay', path]) == 2
    assert '/bot1/' in (error := capsys.readouterr().err) and 'or --namespace of the ro' in error
    assert main(['replay', path, '--namespace', '/bot1']) == 0
    assert 'the same to the last bit' in capsys.readouterr().out
    # Its telemetry was not recorded: only commands can be compared.
    assert main(['replay', path, '--namespace', 'bot2']) == 0
    assert 'the same to the last bit' not in capsys.readouterr().out
    assert main(['replay', path, '--namespace', '/bot3']) == 2
    assert 'no topic in namespace /bot3; it has /bot1/camera_info, ' in capsys.readouterr().err
