"""Executables of the nodes: help, leftover words, ROS that is missing; and the table of nodes."""

from dataclasses import fields
import os
from pathlib import Path
import re
import subprocess
import sys

from durations import few_of
from node_process import node_class, row_of
import pytest

from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.nodes.startup import executables
from visual_servo_epipolar.nodes.startup.table import NODES, owner_of, settings_of

ROOT = Path(__file__).parents[2]
END_SEC = 30.0


def run(code, *words, **environment):
    """Run Python code with words on its command line, as an executable is."""
    return subprocess.run(
        [sys.executable, '-c', f'import sys; sys.argv[0] = "node"\n{code}', *words],
        env={**os.environ, 'PYTHONPATH': str(ROOT), **environment},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=END_SEC,
    )


def executable(node):
    return f'from visual_servo_epipolar.nodes.startup import executables; executables.{node}()'


def module(node):
    code = 'from runpy import run_module as run\n'
    return f"{code}run('visual_servo_epipolar.nodes.{node}', run_name='__main__')"


@pytest.mark.parametrize('start', [executable, module])
@pytest.mark.parametrize('words', few_of([['--help'], ['--ros-args', '--help']]))
def test_help_ends_well_and_starts_nothing(start, words) -> None:
    ended = run(start('servo_node'), *words)
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.startswith('usage: servo_node [--ros-args -p NAME:=VALUE')
    assert max(map(len, ended.stdout.splitlines())) <= 99


def test_help_that_is_not_read_is_quiet() -> None:
    words = [sys.executable, '-c', f'import sys\n{executable("servo_node")}', '--help']
    reading, writing = os.pipe()
    os.close(reading)
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    ended = subprocess.run(
        words, env=environment, stdout=writing, stderr=subprocess.PIPE, timeout=END_SEC
    )
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (141, b'')


@pytest.mark.parametrize('start', few_of([executable, module]))
@pytest.mark.parametrize(
    'words', [['--foo'], ['config.yaml'], ['-p', 'k1:=0.1'], ['--ros-args', '--', 'config.yaml']]
)
def test_what_is_no_ros_argument_is_refused_with_one_line(start, words) -> None:
    ended = run(start('servo_node'), *words)
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1, ended.stderr
    rest = [word for word in words if word not in ('--ros-args', '--')]
    assert f'servo_node: takes ROS arguments alone, got {" ".join(rest)};' in ended.stderr


@pytest.mark.parametrize('first', few_of([True, False]))
def test_the_command_line_wins_over_a_section_of_a_file(first) -> None:
    # rcl reads -p as the section /**, which here comes before that of the rig.
    value, config = ['-p', 'law:=none'], ROOT / 'config'
    robot, panorama = config / 'robot.yaml', config / 'rigs/panorama.yaml'
    words = ['--params-file', robot, '--params-file', panorama]
    words = [*value, *words] if first else [*words, *value]
    ended = run(executable('servo_node'), '--ros-args', *map(str, words))
    assert ended.returncode == 2
    assert "law must be one of paper, corrected, full, smooth, got 'none'" in ended.stderr


def test_an_unknown_ros_argument_is_refused_with_one_line() -> None:
    ended = run(executable('servo_node'), '--ros-args', '--foo')
    assert ended.returncode == 2
    assert ended.stderr == "servo_node: no ROS arguments: ['--foo']; see servo_node --help\n"


@pytest.mark.parametrize(('given', 'kept'), [({}, '1'), ({'OPENBLAS_NUM_THREADS': '3'}, '3')])
def test_small_products_are_not_shared_among_threads_unless_the_user_says_so(given, kept) -> None:
    code = 'import os\nfrom visual_servo_epipolar.nodes.startup import executables\n'
    code += 'def show(name): sys.exit("threads: " + os.environ["OPENBLAS_NUM_THREADS"])\n'
    code += 'executables.import_module = show\nassert "numpy" not in sys.modules\n'
    environment = {'OPENBLAS_NUM_THREADS': '', **given}
    code += '' if given else 'del os.environ["OPENBLAS_NUM_THREADS"]\n'
    ended = run(code + 'executables.servo_node()', **environment)
    assert ended.stderr == f'threads: {kept}\n'


@pytest.mark.parametrize('node', few_of([*NODES]))
def test_without_ros_an_executable_says_so_in_one_line_and_has_its_help(node) -> None:
    code = f'sys.modules["rclpy"] = None\n{executable(node)}'
    ended = run(code)
    reason = rf'{node}: ROS 2 cannot be imported \(.*source your ROS 2 Jazzy.*\n'
    assert ended.returncode == 2
    assert re.fullmatch(reason, ended.stderr), ended.stderr
    ended = run(code, '--help')
    assert (ended.returncode, ended.stderr) == (0, '')


def test_another_missing_package_is_not_taken_for_ros() -> None:
    ended = run(f'sys.modules["rosbags"] = None\n{executable("recorder_node")}')
    assert ended.returncode == 2
    assert ended.stderr.startswith('recorder_node: rosbags is missing; pip install rosbags mcap')


def test_ros_arguments_end_at_two_dashes() -> None:
    words = ['--ros-args', '-p', 'a:=1', '--', 'b', '--ros-args', '-r', 'c:=d']
    assert executables.split(words) == (['-p', 'a:=1', '-r', 'c:=d'], ['b'])


def test_a_parameter_may_be_for_one_node() -> None:
    words = ['-p', 'a:=1', '--param', 'servo:b:=2', '-p', 'tracker:c:=3', '-p', '/ns/servo:d:=4']
    assert executables.parameter_names(words, 'servo') == {'a', 'b', 'd'}


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


def test_every_node_has_a_row_and_an_executable() -> None:
    files = (ROOT / 'visual_servo_epipolar/nodes').glob('*_node.py')
    assert {file.stem for file in files} == set(NODES)
    setup = (ROOT / 'setup.py').read_text()
    names = re.search(r'^NODES = \((.*?)\)$', setup, re.M | re.S)[1]
    assert set(re.findall(r"'(\w+)'", names)) == set(NODES)
    assert "f'{node} = {NAME}.nodes.startup.executables:{node}'" in setup
    for name in NODES:
        assert callable(getattr(executables, name))


ASKED_FOR = {  # topics on demand
    'servo_node': {'odometry': True, 'rig': 'pan_tilt'},
    'camera_node': {'rig': 'pan_tilt'},
    'recorder_node': {'topics': ['none']},
}
OF_EVERY_NODE = {'parameter_events', 'rosout', 'clock', 'tf', 'tf_static'}


@pytest.mark.parametrize('name', NODES)
def test_the_page_of_nodes_names_what_each_is_connected_to(
    name, bench, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the recorder begins a bag where it is started
    node = bench.start(node_class(name), **ASKED_FOR.get(name, {}))
    services = [it.srv_name for it in node.services if 'std_srvs' in it.srv_type.__module__]
    used = (
        [it.topic_name for it in node.subscriptions],
        [it.topic_name for it in node.publishers],
        services,
    )
    for names, named in zip(used, row_of(name), strict=True):
        short = {it.removeprefix('/').replace(f'{name}/', '~/') for it in names}
        assert short - OF_EVERY_NODE <= {it.removeprefix('/') for it in named}


def test_a_parameter_is_known_by_its_node_and_by_its_former_name() -> None:
    assert owner_of('max_features') == 'tracker_node'
    assert owner_of('room') == 'servo_node'
    assert owner_of('zzz') == ''
