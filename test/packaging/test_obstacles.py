"""What stands between servo and base is one chain, of one type of message."""

import json
from pathlib import Path
import re

import yaml

from visual_servo_epipolar.nodes.commands import TOPIC

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config'
FILE = CONFIG / 'obstacles.yaml'
SECTIONS = yaml.safe_load(FILE.read_text(encoding='utf-8'))
MUX = SECTIONS['/**/twist_mux']['ros__parameters']
MONITOR = SECTIONS['/**/collision_monitor']['ros__parameters']
ROBOT = yaml.safe_load((CONFIG / 'robot.yaml').read_text())['/**']['ros__parameters']


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
