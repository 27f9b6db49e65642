"""The command line of the nodes: help, leftover words, and an executable without ROS 2."""

import os
from pathlib import Path
import subprocess
import sys

from durations import few_of
import pytest

from visual_servo_epipolar.nodes.startup import command_line
from visual_servo_epipolar.nodes.startup.table import NODES

ROOT = Path(__file__).parents[3]
END_SEC = 30.0


def run(code, *words, folder=ROOT, stdout=subprocess.PIPE, **environment):
    """Run Python code with words on its command line, as an executable is."""
    return subprocess.run(
        [sys.executable, '-c', f'import sys; sys.argv[0] = "node"\n{code}', *words],
        env={**os.environ, 'PYTHONPATH': str(ROOT), **environment},
        cwd=folder,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        timeout=END_SEC,
    )


def executable(node):
    return f'from visual_servo_epipolar.nodes.startup import executables; executables.{node}()'


def module(node):
    code = 'from runpy import run_module as run\n'
    return f"{code}run('visual_servo_epipolar.nodes.{node}', run_name='__main__')"


@pytest.mark.parametrize('node', NODES)
@pytest.mark.parametrize('option', ['-h', '--help'])
def test_help_says_what_a_node_does_and_takes(node, option, capsys) -> None:
    assert command_line.answer(node, [option]) == 0
    text = capsys.readouterr().out
    row = NODES[node]
    assert text.startswith(f'usage: {node} [--ros-args -p NAME:=VALUE --params-file FILE')
    names = ', '.join((row.subscribes, row.publishes, row.services)).split(', ')
    assert all(word in text for word in (row.does, *names))
    assert max(map(len, text.splitlines())) <= 99


@pytest.mark.parametrize('start', [executable, module])
@pytest.mark.parametrize('words', few_of([['--help'], ['--ros-args', '--help']]))
def test_help_ends_well_and_starts_nothing(start, words) -> None:
    ended = run(start('servo_node'), *words)
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.startswith('usage: servo_node')


@pytest.mark.parametrize('unbuffered', few_of(['', '1']))
def test_help_that_nobody_reads_ends_quietly(unbuffered) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    ended = run(module('servo_node'), '--help', stdout=writer, PYTHONUNBUFFERED=unbuffered)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (141, '')


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


@pytest.mark.parametrize(('told', 'kept'), [({}, '1'), ({'OPENBLAS_NUM_THREADS': '3'}, '3')])
def test_small_products_are_not_shared_among_threads_unless_somebody_says_so(told, kept) -> None:
    code = 'import os\nfrom visual_servo_epipolar.nodes.startup import executables\n'
    code += 'def show(name): sys.exit("threads: " + os.environ["OPENBLAS_NUM_THREADS"])\n'
    code += 'executables.import_module = show\nassert "numpy" not in sys.modules\n'
    environment = {'OPENBLAS_NUM_THREADS': '', **told}
    code += '' if told else 'del os.environ["OPENBLAS_NUM_THREADS"]\n'
    ended = run(code + 'executables.servo_node()', **environment)
    assert ended.stderr == f'threads: {kept}\n'


@pytest.mark.parametrize('node', few_of([*NODES]))
def test_without_ros_an_executable_says_so_in_one_line(node) -> None:
    ended = run(f'sys.modules["rclpy"] = None\n{executable(node)}')
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1, ended.stderr
    assert ended.stderr.startswith(f'{node}: ROS 2 cannot be imported (')
    assert 'source your ROS 2 Jazzy' in ended.stderr


def test_help_needs_no_ros() -> None:
    ended = run(f'sys.modules["rclpy"] = None\n{executable("camera_node")}', '--help')
    assert (ended.returncode, ended.stderr) == (0, '')


def test_another_missing_package_is_not_taken_for_ros() -> None:
    ended = run(f'sys.modules["rosbags"] = None\n{executable("recorder_node")}')
    assert ended.returncode == 2
    assert ended.stderr.startswith('recorder_node: rosbags is missing; pip install rosbags mcap')


def test_ros_arguments_end_at_two_dashes() -> None:
    words = ['--ros-args', '-p', 'a:=1', '--', 'b', '--ros-args', '-r', 'c:=d']
    assert command_line.split(words) == (['-p', 'a:=1', '-r', 'c:=d'], ['b'])


def test_a_parameter_may_be_for_one_node() -> None:
    words = ['-p', 'a:=1', '--param', 'servo:b:=2', '-p', 'tracker:c:=3', '-p', '/ns/servo:d:=4']
    assert command_line.parameter_names(words, 'servo') == {'a', 'b', 'd'}
