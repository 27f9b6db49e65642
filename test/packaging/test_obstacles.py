"""What stands between servo and base: names that those packages know, and one chain."""

import json
from pathlib import Path
import re

import pytest
import yaml

from visual_servo_epipolar.nodes.commands import TOPIC

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config'
FILE = CONFIG / 'obstacles.yaml'
SECTIONS = yaml.safe_load(FILE.read_text(encoding='utf-8'))
MUX = SECTIONS['/**/twist_mux']['ros__parameters']
MONITOR = SECTIONS['/**/collision_monitor']['ros__parameters']
ROBOT = yaml.safe_load((CONFIG / 'robot.yaml').read_text())['/**']['ros__parameters']

# As their sources declare them: twist_mux 4.3, with use_stamped of 4.4; nav2_collision_monitor
# 1.3.13 (Jazzy).
ENTRY = {'topic': str, 'timeout': float, 'priority': int}
MONITORED = {
    'enable_stamped_cmd_vel': bool,
    'base_frame_id': str,
    'odom_frame_id': str,
    'cmd_vel_in_topic': str,
    'cmd_vel_out_topic': str,
    'state_topic': str,
    'transform_tolerance': float,
    'source_timeout': float,
    'base_shift_correction': bool,
    'stop_pub_timeout': float,
    'polygons': list,
    'observation_sources': list,
}
POLYGON = {
    'type': str,
    'points': str,
    'action_type': str,
    'min_points': int,
    'visualize': bool,
    'polygon_pub_topic': str,
    'enabled': bool,
}
SOURCE = {'type': str, 'topic': str, 'enabled': bool, 'source_timeout': float}
WITHOUT_DEFAULT = {'type', 'points', 'action_type'}


def check(values: dict, known: dict[str, type]) -> None:
    """Each value must have a name that is declared, and the type, which ROS insists on."""
    types = {name: type(value) for name, value in values.items()}
    assert types == {name: known.get(name) for name in values}


def test_twist_mux_knows_what_it_is_told() -> None:
    assert MUX.keys() == {'use_stamped', 'topics', 'locks'}
    assert isinstance(MUX['use_stamped'], bool)
    for entry in (*MUX['topics'].values(), *MUX['locks'].values()):
        assert entry.keys() == ENTRY.keys()  # it ends where one is missing
        check(entry, ENTRY)
        assert 0 <= entry['priority'] <= 255


def test_the_collision_monitor_knows_what_it_is_told() -> None:
    parts = {*MONITOR['polygons'], *MONITOR['observation_sources']}
    check({name: value for name, value in MONITOR.items() if name not in parts}, MONITORED)
    assert MONITOR.keys() >= parts
    for name in MONITOR['polygons']:
        check(MONITOR[name], POLYGON)
        assert MONITOR[name].keys() >= WITHOUT_DEFAULT
        assert (MONITOR[name]['type'], MONITOR[name]['action_type']) == ('polygon', 'stop')
    for name in MONITOR['observation_sources']:
        check(MONITOR[name], SOURCE)
        assert MONITOR[name]['type'] == 'scan'


def test_the_zone_lies_round_the_axle() -> None:
    corners = json.loads(MONITOR['stop_zone']['points'])  # text, as it wants it
    for axis in (0, 1):
        assert min(corner[axis] for corner in corners) < 0.0
        assert max(corner[axis] for corner in corners) > 0.0


def test_commands_go_one_way_from_the_servo_to_the_base() -> None:
    started = (ROOT / 'docs/robot.md').read_text(encoding='utf-8')
    given = dict(
        re.findall(r'(?:-r )?(cmd_vel\w*):=(cmd_vel\w*)', started.split('## Obstacles')[1])
    )
    assert given[TOPIC] == MUX['topics']['servo']['topic']
    assert given['cmd_vel_out'] == MONITOR['cmd_vel_in_topic']
    assert MONITOR['cmd_vel_out_topic'] == TOPIC
    assert MUX['topics']['joystick']['priority'] > MUX['topics']['servo']['priority']
    assert MUX['locks']['stop_button']['priority'] == 255  # nothing passes it
    assert MUX['locks']['stop_button']['topic'] == 'stop_button'


def test_all_take_the_same_message_and_frame() -> None:
    stamped = ROBOT['enable_stamped_cmd_vel']
    assert MUX['use_stamped'] == MONITOR['enable_stamped_cmd_vel'] == stamped
    assert MONITOR['base_frame_id'] == ROBOT['base_frame']


@pytest.mark.parametrize('namespace', ['', 'robot1'])
@pytest.mark.parametrize(
    ('node', 'name', 'value'),
    [
        ('twist_mux', 'topics.servo.topic', MUX['topics']['servo']['topic']),
        ('collision_monitor', 'stop_zone.points', MONITOR['stop_zone']['points']),
    ],
)
def test_the_file_reaches_its_nodes_in_a_namespace_too(namespace, node, name, value) -> None:
    rclpy = pytest.importorskip('rclpy')
    context = rclpy.Context()
    rclpy.init(args=['--ros-args', '--params-file', str(FILE)], context=context)
    try:
        reader = rclpy.create_node(
            node,
            namespace=namespace,
            context=context,
            automatically_declare_parameters_from_overrides=True,
        )
        assert reader.get_parameter(name).value == value
        reader.destroy_node()
    finally:
        context.try_shutdown()
