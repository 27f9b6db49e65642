"""The layouts for Foxglove and RViz: every topic in them is one that the nodes publish."""

from collections.abc import Iterator, Mapping
from functools import partial
from importlib import import_module
import json
from pathlib import Path
import re
from typing import Any

from nav_msgs.msg import Odometry
import pytest
from rclpy.node import Node
from sensor_msgs.msg import Image, JointState
from small_cameras import TINY
from visualization_msgs.msg import MarkerArray
import yaml

from visual_servo_epipolar.nodes.lockstep import Lockstep
from visual_servo_epipolar.simulation.scenario import from_document

CONFIG = Path(__file__).parents[2] / 'config'
FOXGLOVE = json.loads((CONFIG / 'foxglove_layout.json').read_text(encoding='utf-8'))
RVIZ = yaml.safe_load((CONFIG / 'visual_servo.rviz').read_text(encoding='utf-8'))
PATH = re.compile(r'(?P<topic>/[\w/]+)\.(?P<fields>[\w.]+)(\[(?P<index>\d+)\])?')
SHOWN_IN_3D = {'visualization_msgs/msg/MarkerArray', 'nav_msgs/msg/Odometry'}
DISPLAYS = {
    'Camera': 'sensor_msgs/msg/Image',
    'MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'Odometry': 'nav_msgs/msg/Odometry',
    'Image': 'sensor_msgs/msg/Image',
}


# Topics of the nodes that are drawn in space, and so need the frame of their headers.
IN_SPACE = {
    'servo_node/markers': MarkerArray,
    'odom': Odometry,
    'ground_truth': Odometry,
    'image_raw': Image,
}


class Listener(Node):
    """Hears the telemetry, and keeps the frames that messages name."""

    def __init__(self, context: Any) -> None:
        super().__init__('listener', context=context)
        self.received: list[JointState] = []
        self.frames: dict[str, str] = {}
        self.create_subscription(JointState, 'epipoles', self.received.append, 10)
        for topic, kind in IN_SPACE.items():
            self.create_subscription(kind, topic, partial(self._on_message, f'/{topic}'), 10)

    def _on_message(self, topic: str, message: Any) -> None:
        header = message.markers[0].header if hasattr(message, 'markers') else message.header
        self.frames[topic] = header.frame_id

    @property
    def done(self) -> bool:
        return bool(self.received) and len(self.frames) == len(IN_SPACE)


@pytest.fixture(scope='module')
def listener() -> tuple[dict[str, str], Listener]:
    """Return the topics of the running nodes with their types, and who listened to them."""
    scenario = from_document({'camera': TINY}, 'tiny')
    with Lockstep(scenario, scenario.loop((0.2, -1.5, 0.0), 0)) as nodes:
        listener = Listener(nodes.context)
        nodes.add(listener)
        nodes.run(lambda: listener.done)
        topics = {name: kinds[0] for name, kinds in listener.get_topic_names_and_types()}
    return topics, listener


@pytest.fixture(scope='module')
def run(listener) -> tuple[dict[str, str], JointState]:
    """Return the topics of the running nodes with their types, and what epipoles looks like."""
    return listener[0], listener[1].received[0]


def plotted() -> Iterator[Mapping[str, Any]]:
    for panel in FOXGLOVE['configById'].values():
        yield from panel.get('paths', [])


def test_what_is_plotted_is_a_number_of_a_published_message(run) -> None:
    topics, _ = run
    paths = [PATH.fullmatch(item['value']) for item in plotted()]
    assert len(paths) >= 10
    for path in paths:
        package, _, name = topics[path['topic']].split('/')
        value = getattr(import_module(f'{package}.msg'), name)()
        for field in path['fields'].split('.'):
            value = getattr(value, field)  # an AttributeError names the field
        assert path['index'] or isinstance(value, (float, str))


def test_numbers_of_epipoles_stand_where_the_layout_looks_for_them(run) -> None:
    signals = [
        (int(match['index']), item['label'])
        for item in plotted()
        if (match := PATH.fullmatch(item['value']))['topic'] == '/epipoles'
    ]
    assert len(signals) >= 4
    assert [run[1].name[index] for index, _ in signals] == [label for _, label in signals]


def test_pictures_and_markers_of_foxglove_are_published(run) -> None:
    topics, _ = run
    panels = FOXGLOVE['configById']
    for name, panel in panels.items():
        if name.startswith('Image!'):
            assert topics[panel['imageMode']['imageTopic']] == 'sensor_msgs/msg/Image'
        if name.startswith('3D!'):
            assert {topics[topic] for topic in panel['topics']} <= SHOWN_IN_3D
        if name.startswith('DiagnosticSummary!'):
            assert topics[panel['topicToRender']] == 'diagnostic_msgs/msg/DiagnosticArray'
    info = panels['Image!camera']['imageMode']['calibrationTopic']
    assert topics[info] == 'sensor_msgs/msg/CameraInfo'


def test_what_rviz_displays_is_published(run) -> None:
    topics, _ = run
    shown = [item for item in RVIZ['Visualization Manager']['Displays'] if 'Topic' in item]
    assert len(shown) >= 5
    for item in shown:
        kind = DISPLAYS[item['Class'].removeprefix('rviz_default_plugins/')]
        assert topics[item['Topic']['Value']] == kind


def test_rviz_shows_all_that_is_drawn_in_space_and_every_image() -> None:
    displays = RVIZ['Visualization Manager']['Displays']
    shown = {item['Topic']['Value'] for item in displays if 'Topic' in item}
    assert {f'/{topic}' for topic in IN_SPACE} <= shown
    assert {'/overlay/image_raw', '/tracker_node/desired/image_raw'} <= shown
    assert any(item['Class'].endswith('/TF') for item in displays)


def test_a_camera_display_has_its_camera_info(run) -> None:
    topics, _ = run
    displays = RVIZ['Visualization Manager']['Displays']
    cameras = [item for item in displays if item['Class'].endswith('/Camera')]
    assert len(cameras) == 1
    for item in cameras:
        info = item['Topic']['Value'].rpartition('/')[0] + '/camera_info'
        assert topics[info] == 'sensor_msgs/msg/CameraInfo'
        names = {each['Name'] for each in displays}
        assert item['Visibility'].keys() - {'Value'} <= names


def test_without_tf_the_fixed_frames_are_those_of_messages_on_show(listener) -> None:
    frames = listener[1].frames
    fixed = RVIZ['Visualization Manager']['Global Options']['Fixed Frame']
    shown = {topic for topic, frame in frames.items() if frame == fixed}
    assert shown == {'/odom'}
    for name, panel in FOXGLOVE['configById'].items():
        if name.startswith('3D!'):
            assert panel['followTf'] in {frames[topic] for topic in panel['topics']}, name
