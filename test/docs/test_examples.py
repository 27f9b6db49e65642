"""The examples of other packages: installed as their reader would, and driven with."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
from typing import Any

import pytest
import small_cameras

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted(path.parent for path in (ROOT / 'docs' / 'examples').glob('*/setup.py'))
LONGEST = 40  # lines of an example, its setup included


@pytest.fixture(scope='module')
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install the examples into a folder, and return an environment that has them."""
    target = tmp_path_factory.mktemp('site')
    pip = [sys.executable, '-m', 'pip', '-qq', '--disable-pip-version-check', 'install']
    options = ['--no-deps', '--no-build-isolation', '--target', str(target)]
    sources = []
    for example in EXAMPLES:
        sources.append(tmp_path_factory.mktemp(example.name))
        shutil.copytree(example, sources[-1], dirs_exist_ok=True)
    subprocess.run([*pip, *options, *map(str, sources)], check=True, timeout=300)
    return os.environ | {'PYTHONPATH': os.pathsep.join([str(target), str(ROOT)])}


def python(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)


def run(environment: dict[str, str], *arguments: str) -> Any:
    done = python(environment, '-m', 'visual_servo_epipolar', *arguments, '--json', '-')
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ('option', 'name'),
    [('law', 'bounded'), pytest.param('estimator', 'linear_8pt', marks=pytest.mark.long)],
)
def test_the_example_drives_the_robot_to_the_goal(environment, option, name) -> None:
    start = ('simulate', '--start', '0.5', '-3', '5')
    result, plain = run(environment, *start, f'--{option}', name), run(environment, *start)
    assert result['outcome'] == 'arrived'
    assert result['position_error_m'] < 0.02
    assert plain['path_length_m'] != result['path_length_m']
    done = python(environment, '-m', 'visual_servo_epipolar', *start, '--estimator', 'linear_9pt')
    assert done.returncode == 2
    assert "soft_planar, linear_8pt, got 'linear_9pt'" in done.stderr


@pytest.mark.long
def test_a_sweep_compares_it(environment: dict[str, str], tmp_path: Path) -> None:
    options = ('--region', 'front', '--runs', '2', '--jobs', '1', '--out', str(tmp_path))
    documents = run(environment, 'sweep', *options, '--compare', 'bounded,full')
    assert set(documents) == {'bounded', 'full'}


def test_a_node_takes_it(environment: dict[str, str]) -> None:
    pytest.importorskip('rclpy')
    code = (
        'import rclpy\n'
        'from rclpy.parameter import Parameter\n'
        'from visual_servo_epipolar.nodes.servo_node import ServoNode\n'
        'rclpy.init()\n'
        "node = ServoNode(parameter_overrides=[Parameter('law', value='bounded')])\n"
        "print(node.get_parameter('law').value)\n"
    )
    done = python(environment, '-c', code)
    assert done.stdout.strip() == 'bounded', done.stderr


def test_a_matcher_of_ones_own_finds_the_photograph(environment: dict[str, str], tmp_path) -> None:
    scenario = tmp_path / 'orb.yaml'
    camera = small_cameras.sized(320, 256, 192.3, 158.4, 127.6)
    scenario.write_text(json.dumps({'tracker': {'matcher': 'orb'}, 'camera': camera}))
    start = ('--start', '0.2', '-1.2', '3', '--source', 'images')
    result = run(environment, 'simulate', *start, '--scenario', str(scenario))
    assert result['outcome'] == 'arrived'
    assert result['position_error_m'] < 0.01


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda path: path.name)
def test_an_example_is_short(example: Path) -> None:
    lines = sum(len(file.read_text().splitlines()) for file in example.glob('*.py'))
    assert lines <= LONGEST
