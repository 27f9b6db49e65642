"""The layouts for Foxglove and RViz: every topic in them is one that the nodes publish."""

from collections.abc import Iterator, Mapping
from importlib import import_module
import json
from pathlib import Path
import re
from typing import Any

import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState
from small_cameras import TINY
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


@pytest.fixture(scope='module')
def run() -> tuple[dict[str, str], JointState]:
    """Return the topics of the running nodes with their types, and what epipoles looks like."""
    scenario = from_document({'camera': TINY}, 'tiny')
    received: list[JointState] = []
    with Lockstep(scenario, scenario.loop((0.2, -1.5, 0.0), 0)) as nodes:
        listener = Node('listener', context=nodes.context)
        listener.create_subscription(JointState, 'epipoles', received.append, 10)
        nodes.add(listener)
        nodes.run(lambda: bool(received))
        topics = {name: kinds[0] for name, kinds in listener.get_topic_names_and_types()}
    return topics, received[0]


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
