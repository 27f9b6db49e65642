"""The launch files: executables, files, topics and parameters in them exist, and are used."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
import re
import sys
from types import SimpleNamespace
from typing import Any

from loaded import loaded, ROOT
from node_process import row_of
import pytest
import yaml

from visual_servo_epipolar.nodes.startup.table import NODES, parameter_names

PACKAGE = 'visual_servo_epipolar'
FILES = sorted(path.name for path in (ROOT / 'launch').glob('*.py'))
EVERYTHING = {
    'simulation.launch.py': {'record': '/bags/one', 'rviz': 'true'},
    'robot.launch.py': {'record': '/bags/one', 'lifecycle': 'nav2', 'dock': 'serve'},
    'route.launch.py': {'record': '/bags/one', 'simulate': 'true'},
}
OTHERS = {'rviz2': 'rviz2', 'lifecycle_manager': 'nav2_lifecycle_manager'}  # by executable
RVIZ = yaml.safe_load((ROOT / 'config/visual_servo.rviz').read_text(encoding='utf-8'))


# A stand-in for launch and launch_ros, which pip lacks: just what our launch files use.
class Configurations(dict[str, str]):
    """Values of the arguments; remembers which were asked for."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.used: set[str] = set()

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        return super().__getitem__(name)


def _stand_in(name: str, *fields: str) -> type:
    return make_dataclass(name, fields, frozen=True)


LaunchConfiguration = _stand_in('LaunchConfiguration', 'name')
FindPackageShare = _stand_in('FindPackageShare', 'package')
PathJoinSubstitution = _stand_in('PathJoinSubstitution', 'parts')
ParameterValue = _stand_in('ParameterValue', 'value', 'value_type')
LaunchDescription = _stand_in('LaunchDescription', 'entities')
OpaqueFunction = _stand_in('OpaqueFunction', 'function')


@dataclass(frozen=True)
class DeclareLaunchArgument:
    name: str
    default_value: str
    description: str
    choices: list[str] | None = None


@dataclass
class Node:
    package: str
    executable: str
    name: str = ''
    namespace: str = ''
    parameters: list[Any] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    output: str = 'log'


MODULES = {
    'launch': [LaunchDescription],
    'launch.actions': [DeclareLaunchArgument, OpaqueFunction],
    'launch.substitutions': [LaunchConfiguration, PathJoinSubstitution],
    'launch_ros': [],
    'launch_ros.actions': [Node],
    'launch_ros.parameter_descriptions': [ParameterValue],
    'launch_ros.substitutions': [FindPackageShare],
}


class Launch:
    """What a launch file comes to with some arguments: nodes, with paths and values filled in."""

    def __init__(self, name: str, **arguments: str) -> None:
        self.nodes: list[Node] = []
        self.declared: dict[str, DeclareLaunchArgument] = {}
        self.configurations = Configurations(arguments)
        unknown = set(arguments)
        for entity in loaded(ROOT / 'launch' / name).generate_launch_description().entities:
            self._visit(entity, self.configurations)
        assert unknown <= self.declared.keys()

    def _visit(self, entity: Any, values: Configurations) -> None:
        if isinstance(entity, DeclareLaunchArgument):
            self.declared.setdefault(entity.name, entity)
            value = values.setdefault(entity.name, entity.default_value)
            assert entity.choices is None or value in entity.choices, (entity.name, value)
        elif isinstance(entity, OpaqueFunction):
            context = SimpleNamespace(launch_configurations=values)
            for item in entity.function(context):
                self._visit(item, values)
        else:
            assert isinstance(entity, Node), entity
            entity.parameters = [resolved(item, values) for item in entity.parameters]
            entity.arguments = [resolved(item, values) for item in entity.arguments]
            self.nodes.append(entity)


def resolved(item: Any, values: Configurations) -> Any:
    """Return text, numbers and dicts for substitutions."""
    if isinstance(item, LaunchConfiguration):
        return values[item.name]
    if isinstance(item, FindPackageShare):
        assert item.package == 'visual_servo_epipolar'
        return str(ROOT)
    if isinstance(item, PathJoinSubstitution):
        return '/'.join(resolved(part, values) for part in item.parts)
    if isinstance(item, ParameterValue):
        text = resolved(item.value, values)
        return text == 'true' if item.value_type is bool else item.value_type(text)
    if isinstance(item, dict):
        return {name: resolved(value, values) for name, value in item.items()}
    return item


@pytest.fixture(autouse=True)
def stub(monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    for file in ('mine.yaml', 'servo.yaml', 'base.yaml', 'robot.yaml'):
        Path(file).touch()
    for name, members in MODULES.items():
        module = SimpleNamespace(**{member.__name__: member for member in members})
        monkeypatch.setitem(sys.modules, name, module)


def ours(launch: Launch):
    return [node for node in launch.nodes if node.package == PACKAGE]


def by_name(launch: Launch):
    return {node.executable: node for node in launch.nodes}


def values(node) -> dict[str, object]:
    """Return the parameters that the launch file itself gives, later ones over earlier ones."""
    dicts = (item for item in node.parameters if isinstance(item, dict))
    return {key: value for item in dicts for key, value in item.items()}


def test_each_launch_file_is_tested_here() -> None:
    assert FILES == sorted(EVERYTHING)


@pytest.mark.parametrize('name', FILES)
def test_nodes_are_entry_points_and_their_files_exist(name) -> None:
    launch = Launch(name, **EVERYTHING[name])
    assert {node.executable for node in ours(launch)} <= NODES.keys()
    assert {node.package for node in launch.nodes} <= {PACKAGE, *OTHERS.values()}
    for node in launch.nodes:
        paths = [item for item in (*node.parameters, *node.arguments) if '/' in str(item)]
        files = [Path(item) for item in paths if isinstance(item, str) and item.startswith('/')]
        assert [path for path in files if not path.is_file()] == []
        assert node.executable in OTHERS or files, f'{node.executable} has no settings'


@pytest.mark.parametrize('name', FILES)
def test_each_argument_is_described_and_used(name) -> None:
    launch = Launch(name, **EVERYTHING[name])
    own = {
        node.args[0].value
        for node in ast.walk(ast.parse((ROOT / 'launch' / name).read_text(encoding='utf-8')))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == 'argument'
    }
    assert own <= launch.declared.keys()
    for argument in launch.declared.values():
        assert len(argument.description) > 10, argument.name
    # One that is not declared is a KeyError; launch itself asks for the time to end.
    assert own - {'sigterm_timeout'} <= launch.configurations.used


@pytest.mark.parametrize('name', FILES)
def test_a_recorder_has_time_to_complete_its_bag(name) -> None:
    # launch gives 5 s from Ctrl-C to SIGTERM, and as many to SIGKILL; a group forgets its own.
    assert float(Launch(name).configurations['sigterm_timeout']) >= 20.0


@pytest.mark.parametrize('name', FILES)
def test_remapped_topics_are_topics_of_the_nodes(name) -> None:
    for node in ours(Launch(name)):
        subscribed, published, _ = row_of(node.executable)
        assert {topic for topic, _ in node.remappings} <= subscribed | published


@pytest.mark.parametrize('name', FILES)
def test_parameters_are_parameters_of_the_nodes(name) -> None:
    given = {
        'simulation.launch.py': {
            'start': '[1, -2, 3]',
            'seed': '4',
            'namespace': 'r',
            'desired_image': 'goal.png',
            'autostart': 'false',
            'use_sim_time': 'true',
        },
        'robot.launch.py': {
            'desired_image': 'goal.png',
            'autostart': 'true',
            'use_sim_time': 'true',
        },
        'route.launch.py': {'route': 'hall', 'autostart': 'true', 'start': '[1, -2, 3]'},
    }
    for node in ours(Launch(name, **EVERYTHING[name], **given.get(name, {}))):
        known = parameter_names(node.executable) | {'use_sim_time'}
        assert values(node).keys() <= known, node.executable


SIMULATED = ['unicycle_node', 'camera_node', 'tracker_node', 'servo_node']
REAL = ['tracker_node', 'servo_node']


@pytest.mark.parametrize(
    ('name', 'usual', 'more', 'others'),
    [
        ('simulation.launch.py', SIMULATED, {'rviz': 'true'}, ['recorder_node', 'rviz2']),
        ('robot.launch.py', REAL, {}, ['recorder_node']),
    ],
)
def test_its_nodes_run_and_more_only_if_asked_for(name, usual, more, others) -> None:
    assert [node.executable for node in Launch(name).nodes] == usual
    launch = Launch(name, record='/bags/one', **more)
    assert sorted(node.executable for node in launch.nodes) == sorted([*usual, *others])
    assert values(by_name(launch)['recorder_node']) == {'bag': '/bags/one'}


@pytest.mark.parametrize('name', ['simulation.launch.py', 'robot.launch.py'])
def test_what_is_left_empty_is_left_to_the_files(name) -> None:
    for node in Launch(name).nodes:
        assert all(isinstance(item, str) for item in node.parameters), node.executable


@pytest.mark.parametrize('name', ['simulation.launch.py', 'robot.launch.py'])
def test_own_parameters_win_over_ours_and_arguments_over_both(name) -> None:
    launch = Launch(name, params_file='mine.yaml', use_sim_time='true')
    for node in (by_name(launch)['tracker_node'], by_name(launch)['servo_node']):
        assert node.parameters[0].startswith(str(ROOT))
        assert node.parameters[1:] == ['mine.yaml', {'use_sim_time': True}]


@pytest.mark.parametrize('name', ['simulation.launch.py', 'robot.launch.py'])
def test_a_rig_is_a_file_of_ours_or_a_name_and_own_parameters_win_over_it(name) -> None:
    launch = Launch(name, rig='fisheye', params_file='mine.yaml')
    for node in (by_name(launch)['tracker_node'], by_name(launch)['servo_node']):
        assert node.parameters[1:] == [str(ROOT / 'config/rigs/fisheye.yaml'), 'mine.yaml']
    assert by_name(Launch(name, rig='mine.yaml'))['servo_node'].parameters[1:] == ['mine.yaml']


REFUSED = [
    *(
        (name, arguments, reason)
        for name in ('simulation.launch.py', 'robot.launch.py')
        for arguments, reason in (
            ({'rig': 'fishey'}, r"one of car, .*got 'fishey'; did you mean fisheye"),
            # launch itself warns, and starts the robot with the limits of ours.
            ({'params_file': '/robto.yaml'}, 'there is no parameter file /robto.yaml; give the p'),
        )
    ),
    *(
        (
            'simulation.launch.py',
            {'start': start},
            rf'three numbers, .*got {re.escape(repr(start))};',
        )
        for start in ('home', '[1.0, 2.0]')
    ),
]


@pytest.mark.parametrize(('name', 'arguments', 'reason'), REFUSED)
def test_a_wrong_argument_is_refused_in_one_line(name, arguments, reason) -> None:
    with pytest.raises(RuntimeError, match=reason):
        Launch(name, **arguments)


def test_own_parameters_reach_those_nodes_alone_that_they_are_for() -> None:
    # Under /**: servo and base would share max_linear, servo and recorder autostart.
    launch = Launch(
        'simulation.launch.py', params_file='servo.yaml', world_file='base.yaml', record='/bag'
    )
    files = {node.executable: node.parameters[1] for node in launch.nodes}
    assert files == {
        'unicycle_node': 'base.yaml',
        'camera_node': 'base.yaml',
        'tracker_node': 'servo.yaml',
        'servo_node': 'servo.yaml',
        'recorder_node': {'bag': '/bag'},
    }
    robot = by_name(Launch('robot.launch.py', params_file='servo.yaml', record='/bag'))
    assert robot['recorder_node'].parameters[1:] == [{'bag': '/bag'}]


@pytest.mark.parametrize('name', ['simulation.launch.py', 'robot.launch.py'])
def test_topics_go_where_they_are_sent(name) -> None:
    topics = {'image': '/cam/image', 'camera_info': '/cam/info', 'cmd_vel': '/base/cmd'}
    robots = {'odom': '/base/odom', 'joint_states': '/joints', 'head_command': '/neck'}
    robots = robots if name == 'robot.launch.py' else {}
    nodes = by_name(Launch(name, namespace='r', **topics, **robots))
    image, info = ('image_raw', '/cam/image'), ('camera_info', '/cam/info')
    remapped = {
        name: [it for it in node.remappings if 'tf' not in it[1]] for name, node in nodes.items()
    }
    assert remapped['tracker_node'] == [image, info]
    sent = [(key.replace('head_command', 'head/command'), topic) for key, topic in robots.items()]
    expected = [info, ('cmd_vel', '/base/cmd'), *sent]
    assert remapped['servo_node'] == expected
    if 'camera_node' in nodes:
        assert remapped['camera_node'] == [image, info]
        assert remapped['unicycle_node'] == [('cmd_vel', '/base/cmd')]
    assert {node.namespace for node in nodes.values()} == {'r'}


@pytest.mark.parametrize(('dock', 'last'), [('none', []), ('pose', ['dock_node'])])
@pytest.mark.parametrize(('record', 'first'), [('', []), ('/bags/one', ['recorder_node'])])
def test_the_manager_of_nav2_leads_all_nodes_without_a_bond(record, first, dock, last) -> None:
    launch = Launch('robot.launch.py', namespace='r', lifecycle='nav2', record=record, dock=dock)
    *led, manager = launch.nodes
    assert (manager.executable, manager.namespace) == ('lifecycle_manager', 'r')
    assert values(manager) == {
        'autostart': True,
        'bond_timeout': 0.0,
        'node_names': [*first, 'tracker_node', 'servo_node', *last],
    }
    assert {node.executable for node in led} == set(values(manager)['node_names'])
    assert [values(node)['autostart_node'] for node in led] == [False] * len(led)


def test_nodes_that_are_led_by_hand_have_no_manager() -> None:
    launch = Launch('robot.launch.py', lifecycle='manual')
    assert [values(node) for node in launch.nodes] == [{'autostart_node': False}] * 2


@pytest.mark.parametrize(('dock', 'serves'), [('pose', False), ('serve', True)])
def test_a_dock_node_takes_files_and_topics_of_tracker_and_servo(dock, serves) -> None:
    topics = {'camera_info': '/cam/info', 'odom': '/base/odom', 'cmd_vel': '/base/cmd'}
    launch = Launch('robot.launch.py', namespace='r', dock=dock, params_file='mine.yaml', **topics)
    node = by_name(launch)['dock_node']
    assert values(node) == {'serve_action': serves}
    names = [Path(item).name for item in node.parameters[:3]]
    assert names == ['dock_node.yaml', 'robot.yaml', 'mine.yaml']
    assert (dict(node.remappings), node.namespace) == (topics, 'r')


def test_start_and_seed_reach_base_and_camera() -> None:
    nodes = by_name(Launch('simulation.launch.py', start='[1, -2.5, 30]', seed='7'))
    assert values(nodes['unicycle_node']) == {'start': [1.0, -2.5, 30.0], 'seed': 7}
    assert values(nodes['camera_node']) == {'seed': 7}
    assert all(type(number) is float for number in values(nodes['unicycle_node'])['start'])


def test_the_small_camera_is_the_large_one_and_a_file_after_it() -> None:
    large = by_name(Launch('simulation.launch.py'))['camera_node']
    small = by_name(Launch('simulation.launch.py', camera_size='640x480'))['camera_node']
    assert [Path(item).name for item in small.parameters if isinstance(item, str)] == [
        'camera_node.yaml',
        'camera_node_640x480.yaml',
    ]
    assert small.parameters[1:] != large.parameters[1:]


def test_robots_in_namespaces_have_a_tree_of_frames_each() -> None:
    nodes = by_name(Launch('simulation.launch.py', namespace='r', rviz='true'))
    tree = {('/tf', 'tf'), ('/tf_static', 'tf_static')}
    owners = {name: tree & set(node.remappings) for name, node in nodes.items()}
    assert owners == {
        'unicycle_node': {('/tf', 'tf')},
        'camera_node': {('/tf_static', 'tf_static')},
        'servo_node': {('/tf_static', 'tf_static')},
        'tracker_node': set(),
        'rviz2': tree,
    }


def test_a_recorder_in_a_namespace_records_that_robot_alone() -> None:
    def topics(**arguments: str) -> object:
        launch = Launch('simulation.launch.py', record='/bags/one', **arguments)
        return values(by_name(launch)['recorder_node']).get('topics')

    assert topics(namespace='/r') == ['/r/*', '/diagnostics', '/clock']
    assert topics(namespace='r', image='/cam/image')[-1] == '/cam/image'
    assert topics() is None


def test_rviz_finds_every_topic_of_its_layout_in_the_namespace() -> None:
    module = loaded(ROOT / 'launch/simulation.launch.py')
    displays = RVIZ['Visualization Manager']['Displays']
    shown = {item['Topic']['Value'] for item in displays if 'Topic' in item}
    node = by_name(Launch('simulation.launch.py', rviz='true', image='picture'))['rviz2']
    assert dict(node.remappings)['/image_raw'] == 'picture'
    assert shown <= {topic for topic, _ in node.remappings}
    assert {f'/{topic}' for topic in module.SHOWN} <= shown


def test_launch_files_are_installed() -> None:
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    assert "(f'{SHARE}/launch', sorted(glob('launch/*.launch.py')))" in setup
    assert all(name.endswith('.launch.py') for name in FILES)
