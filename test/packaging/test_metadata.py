"""What the package says of itself, and the chain of commands between servo and base."""

import json
from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import yaml

import visual_servo_epipolar
from visual_servo_epipolar.nodes.commands import TOPIC

ROOT = Path(__file__).parents[2]
VERSION = visual_servo_epipolar.__version__


def setup_says(option: str) -> str:
    ran = subprocess.run(
        [sys.executable, 'setup.py', '--quiet', option],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return ran.stdout.strip()


def test_package_xml_and_setup_py_carry_the_version_and_the_name_of_the_package() -> None:
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.findtext('version') == VERSION == setup_says('--version')
    assert package.findtext('name') == 'visual_servo_epipolar' == setup_says('--name')
    assert f'\nversion: {VERSION}\n' in (ROOT / 'CITATION.cff').read_text()
    assert re.fullmatch(r'\d+\.\d+\.\d+', VERSION)  # catkin takes no other form


def test_package_xml_and_setup_py_agree_on_the_licence() -> None:
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.findtext('license') == 'Apache-2.0' == setup_says('--license')


def test_the_change_log_is_open_or_knows_the_version() -> None:
    text = (ROOT / 'CHANGELOG.rst').read_text()
    headings = re.findall(r'^(Forthcoming|\d+\.\d+\.\d+) ?.*\n-+$', text, re.M)
    assert {'Forthcoming', VERSION} & set(headings)


def test_what_setup_py_promises_is_what_the_oldest_versions_are_tested_on() -> None:
    tested = dict(
        line.partition('#')[0].strip().split('==')
        for line in (ROOT / 'constraints-oldest.txt').read_text().splitlines()
        if '==' in line
    )
    text = (ROOT / 'setup.py').read_text()
    promised = dict(re.findall(r"'([\w-]+)(?:\[\w+\])?>=([\d.]+)", text))
    assert promised.keys() >= {'numpy', 'opencv-python-headless', 'matplotlib', 'PyYAML'}
    assert promised == {name: tested[name] for name in promised}


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
