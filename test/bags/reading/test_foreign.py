"""Bags of others: another robot's names and encodings, other distributions, two robots."""

from collections.abc import Callable
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


def renamed(messages: list[Message], change: Callable[[Message], object]) -> list[Message]:
    """Return the images as ``change`` makes them, and the rest as it was, under /front."""
    return [
        (
            '/front/camera_info' if topic == '/camera_info' else '/front/picture',
            log_ns,
            raw if topic == '/camera_info' else serialize_message(change((topic, log_ns, raw))),
        )
        for topic, log_ns, raw in messages
    ]


def as_png(message: Message) -> CompressedImage:
    image = decoded(message)
    encoded = CompressedImage(format='mono8; png compressed mono8')
    encoded.header = write.header(read.stamp_ns(image.header), 'front')
    encoded.data.frombytes(cv2.imencode('.png', read.gray(image))[1].tobytes())
    return encoded


FRONT = {'/front/camera_info': 'sensor_msgs/msg/CameraInfo'}


def test_driver_and_photograph_give_the_commands(driver, small_run, photograph, tmp_path) -> None:
    path = write_bag(tmp_path / 'driver', driver)
    steps = replayed(path, desired=photograph).steps
    assert twists(steps) == published(small_run)[: len(steps)]
    assert len(steps) == 20


def test_compressed_images_give_them_as_well(driver, small_run, photograph, tmp_path) -> None:
    kinds = {**FRONT, '/front/picture': 'sensor_msgs/msg/CompressedImage'}
    path = write_bag(tmp_path / 'png', renamed(driver, as_png), kinds=kinds)
    for topics in ({}, {'image': '/front/picture', 'camera_info': 'front/camera_info'}):
        steps = replayed(path, topics, desired=photograph).steps
        assert twists(steps) == published(small_run)[: len(steps)]


def as_jpeg(gray: np.ndarray, stamp_ns: int = 0, *, quality: int = 80) -> CompressedImage:
    encoded = CompressedImage(format='mono8; jpeg compressed ')
    encoded.header = write.header(stamp_ns, 'front')
    data = cv2.imencode('.jpg', gray, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    encoded.data.frombytes(data.tobytes())
    return encoded


def compressed(messages: list[Message], photograph: np.ndarray) -> list[Message]:
    """Return what a camera of compressed images would have sent, with the photograph."""
    made: list[Message] = [
        ('/desired/image_raw/compressed', 0, serialize_message(as_jpeg(photograph)))
    ]
    for item in messages:
        topic, log_ns, raw = item
        if topic == '/image_raw':
            image = decoded(item)
            packed = as_jpeg(read.gray(image), read.stamp_ns(image.header))
            topic, raw = '/image_raw/compressed', serialize_message(packed)
        made.append((topic, log_ns, raw))
    return made


def test_compressed_images_are_replayed_by_name(driver, small_run, photograph, tmp_path) -> None:
    kinds = dict.fromkeys(
        ('/image_raw/compressed', '/desired/image_raw/compressed'),
        'sensor_msgs/msg/CompressedImage',
    )
    path = write_bag(tmp_path / 'jpeg', compressed(driver, photograph), kinds=kinds)
    steps = replayed(path).steps
    assert len(steps) == 20
    np.testing.assert_allclose(twists(steps), published(small_run)[:20], atol=0.02)
    assert all(step.telemetry['features'] >= 59 for step in steps)  # JPEG may cost one


@pytest.mark.parametrize('transport', ['raw', 'compressed'])
def test_of_two_transports_that_taken_is_replayed(
    driver, small_run, photograph, tmp_path, transport
) -> None:
    jpegs = [item for item in compressed(driver, photograph) if item[0] != '/camera_info']
    settings = next(decoded(item) for item in small_run if item[0] == '/tracker_node/settings')
    text = settings.data.replace('transport: raw', f'transport: {transport}')
    told: Message = ('/tracker_node/settings', 0, serialize_message(write.text(text)))
    kinds = dict.fromkeys(
        ('/image_raw/compressed', '/desired/image_raw/compressed'),
        'sensor_msgs/msg/CompressedImage',
    )
    path = write_bag(tmp_path / 'both', [told, *jpegs, *driver], kinds=kinds)
    with Bag(path) as bag:
        expected = '/image_raw' if transport == 'raw' else '/image_raw/compressed'
        assert assign_roles(bag, {})['image'].name == expected
        assert assign_roles(bag, {'image': 'image_raw'})['image'].name == '/image_raw'


def write_humble(path: Path, messages: list[Message]) -> Path:
    """Write a bag as humble does: sqlite3, no definitions, QoS as text, no hashes."""
    path.mkdir()
    names = list(dict.fromkeys(topic for topic, _, _ in messages))
    with sqlite3.connect(path / 'run_0.db3') as base:
        base.execute(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
            'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)'
        )
        base.execute(
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, '
            'timestamp INTEGER NOT NULL, data BLOB NOT NULL)'
        )
        rows = [(n, name, kind_of(name), 'cdr', '') for n, name in enumerate(names, start=1)]
        base.executemany('INSERT INTO topics VALUES (?, ?, ?, ?, ?)', rows)
        base.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
            [(names.index(topic) + 1, log_ns, raw) for topic, log_ns, raw in messages],
        )
    base.close()
    topics = [
        {
            'message_count': sum(topic == name for topic, _, _ in messages),
            'topic_metadata': {
                'name': name,
                'type': kind_of(name),
                'serialization_format': 'cdr',
                'offered_qos_profiles': '',
            },
        }
        for name in names
    ]
    information = {
        'version': 5,
        'storage_identifier': 'sqlite3',
        'duration': {'nanoseconds': messages[-1][1] - messages[0][1]},
        'starting_time': {'nanoseconds_since_epoch': messages[0][1]},
        'message_count': len(messages),
        'topics_with_message_count': topics,
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': ['run_0.db3'],
    }
    text = yaml.safe_dump({'rosbag2_bagfile_information': information})
    (path / 'metadata.yaml').write_text(text)
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
