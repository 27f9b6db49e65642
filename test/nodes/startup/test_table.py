"""The table of the nodes: none is missing, and its rows say what the nodes really have."""

from dataclasses import fields
from importlib import import_module
import inspect
from pathlib import Path
import re

import pytest

from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.nodes.startup import executables
from visual_servo_epipolar.nodes.startup.table import NODES, owner_of, settings_of

ROOT = Path(__file__).parents[3]
OF_EVERY_NODE = {'/parameter_events', '/rosout'}
# Of a sixth package of messages, which need not be there.
ASKED_FOR = {  # topics on demand
    'servo_node': {'odometry': True, 'rig': 'pan_tilt'},
    'camera_node': {'rig': 'pan_tilt'},
}
OPTIONAL = re.compile('/tf(_static)?|/ackermann_cmd')


def kind_of(node):
    name = ''.join(part.capitalize() for part in node.split('_'))
    return getattr(import_module(f'visual_servo_epipolar.nodes.{node}'), name)


@pytest.fixture(params=NODES)
def node(request, bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the recorder begins a bag where it is started
    return bench.start(kind_of(request.param), **ASKED_FOR.get(request.param, {}))


def test_every_node_has_a_row() -> None:
    files = (ROOT / 'visual_servo_epipolar/nodes').glob('*_node.py')
    assert {file.stem for file in files} == set(NODES)


def test_every_parameter_that_names_a_file_is_a_path() -> None:
    paths = set()
    for item in {item for name in NODES for kind in settings_of(name) for item in fields(kind)}:
        limits = range_of(item)
        if isinstance(item.default, str) and re.match(
            r'(ONNX )?(file|folder)\b', limits.text, re.IGNORECASE
        ):
            assert limits.path, item.name
            paths.add(item.name)
    assert paths == {'bag', 'desired_image', 'matcher_model', 'photograph', 'route'}


def test_every_row_is_an_executable() -> None:
    setup = (ROOT / 'setup.py').read_text()
    names = re.search(r'^NODES = \((.*?)\)$', setup, re.M | re.S)[1]
    assert set(re.findall(r"'(\w+)'", names)) == set(NODES)
    assert "f'{node} = {NAME}.nodes.startup.executables:{node}'" in setup
    for name in NODES:
        assert callable(getattr(executables, name))


@pytest.mark.parametrize('name', NODES)
def test_a_row_has_the_settings_that_the_node_declares(name) -> None:
    module = import_module(f'visual_servo_epipolar.nodes.{name}')
    declared = re.findall(r'parameters\.declare\(self, (\w+)\)', inspect.getsource(module))
    assert list(settings_of(name)) == [getattr(module, kind) for kind in declared]


def test_a_row_has_the_topics_and_services_of_the_node(node) -> None:
    row = NODES[node.get_name()]
    published = {item.topic_name for item in node.publishers} - OF_EVERY_NODE
    assert full(node, row.publishes.split(', ')) == without_optional(published)
    if node.get_name() != 'recorder_node':  # it takes what there is
        heard = {item.topic_name for item in node.subscriptions} - OF_EVERY_NODE
        assert full(node, row.subscribes.split(', ')) == without_optional(heard)
    std = [item for item in node.services if item.srv_type.__module__.startswith('std_srvs.')]
    triggers = {item.srv_name for item in std}
    names = filter(None, row.services.split(', '))
    served = {name.replace('~', f'/{node.get_name()}') for name in names}
    assert {f'/{name.lstrip("/")}' for name in map(node.resolve_service_name, triggers)} == served


def full(node, topics):
    return without_optional({node.resolve_topic_name(topic) for topic in topics})


def without_optional(topics):
    return {topic for topic in topics if not OPTIONAL.fullmatch(topic)}


def test_a_parameter_is_known_by_its_node_and_by_its_former_name() -> None:
    assert owner_of('max_features') == 'tracker_node'
    assert owner_of('room') == 'servo_node'
    assert owner_of('zzz') == ''
