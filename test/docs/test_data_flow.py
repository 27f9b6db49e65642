"""The picture of the data flow: its nodes exist, its topics are theirs, and it stays small."""

from collections.abc import Callable
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
LARGEST_BYTES = 150_000
# The arrows from node to node: topic, who publishes it, who subscribes to it.
LOOP = {
    'ground_truth': ('unicycle_node', ['camera_node']),
    'image_raw': ('camera_node', ['tracker_node']),
    'desired/image_raw': ('camera_node', ['tracker_node']),
    'camera_info': ('camera_node', ['tracker_node', 'servo_node']),
    'tracks': ('tracker_node', ['servo_node']),
    'cmd_vel': ('servo_node', ['unicycle_node']),
}
FILE = 'a bag'  # drawn as a topic is

Topics: TypeAlias = Callable[[Path], set[str]]


@pytest.fixture(scope='module')
def figure() -> ModuleType:
    spec = importlib.util.spec_from_file_location('data_flow', DOCS / 'data_flow_figure.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def source(node: str) -> Path:
    return ROOT / 'visual_servo_epipolar' / 'nodes' / f'{node}.py'


def test_what_a_node_is_drawn_to_publish_it_publishes(figure, published) -> None:
    for node, topics in figure.OUTPUTS.items():
        assert set(topics.split()) <= published(source(node)), node


@pytest.mark.parametrize('topic', LOOP)
def test_an_arrow_leads_from_a_publisher_to_its_subscribers(topic, published, subscribed) -> None:
    start, ends = LOOP[topic]
    assert topic in published(source(start))
    assert [node for node in ends if topic not in subscribed(source(node))] == []


def test_every_topic_that_is_drawn_is_tested_here(figure: ModuleType) -> None:
    (axes,) = figure.draw().axes
    texts = (text for text in axes.texts if text.get_fontfamily() == ['monospace'])
    drawn = {line for text in texts for line in text.get_text().split('\n')}
    others = {topic for topics in figure.OUTPUTS.values() for topic in topics.split()}
    assert drawn == LOOP.keys() | others | {FILE}


def test_the_picture_is_drawn_and_small(figure: ModuleType, tmp_path: Path) -> None:
    figure.main(tmp_path / 'data_flow.png')
    assert 10_000 < (tmp_path / 'data_flow.png').stat().st_size < LARGEST_BYTES
    assert (DOCS / 'data_flow.png').stat().st_size < LARGEST_BYTES
