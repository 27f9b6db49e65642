"""The launch files under the real launch, where it is installed: pip does not have it."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
import os
from pathlib import Path
import signal
import subprocess
import sys

from bench import Bench, next_domain
import pytest
from std_msgs.msg import String

from visual_servo_epipolar.nodes import qos

ROOT = Path(__file__).parents[2]
PACKAGE = 'visual_servo_epipolar'
NODES = ('unicycle_node', 'camera_node', 'tracker_node', 'servo_node', 'recorder_node')
START_SEC, END_SEC = 120.0, 90.0
RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
file, *arguments = sys.argv[1:]
service = LaunchService()
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
    PythonLaunchDescriptionSource(file),
    launch_arguments=[argument.split(':=') for argument in arguments])]))
sys.exit(service.run())
"""


def is_installed() -> bool:
    """Whether launch is there: our own folder launch/ passes for an empty package of that name."""
    try:
        import_module('launch_ros.actions')
    except ImportError:
        return False
    return hasattr(import_module('launch'), 'LaunchService')


PREFIXES = 'AMENT_PREFIX_PATH'
pytestmark = [
    pytest.mark.skipif(not is_installed(), reason='launch is not installed'),
    pytest.mark.skipif(
        not os.environ.get(PREFIXES), reason=f'launch is there, but no ROS is sourced: {PREFIXES}'
    ),
]


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """Return a prefix as colcon leaves it, made of links to this source."""
    (tmp_path / f'lib/{PACKAGE}').mkdir(parents=True)
    for node in NODES:
        script = tmp_path / f'lib/{PACKAGE}/{node}'
        script.write_text(f'#!/bin/sh\nexec {sys.executable} -m {PACKAGE}.nodes.{node} "$@"\n')
        script.chmod(0o755)
    index = tmp_path / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / PACKAGE).touch()
    (tmp_path / f'share/{PACKAGE}').mkdir()
    for folder in ('config', 'launch'):
        (tmp_path / f'share/{PACKAGE}/{folder}').symlink_to(ROOT / folder)
    return tmp_path


@contextmanager
def launched(prefix: Path, domain: int, name: str, *arguments: str) -> Iterator[Path]:
    """Launch a file; on the way out end it by SIGINT, and insist on a clean end."""
    log = prefix / 'output.txt'
    environment = {
        **os.environ,
        'PYTHONPATH': os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')]),
        'AMENT_PREFIX_PATH': os.pathsep.join([str(prefix), os.environ[PREFIXES]]),
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    command = [sys.executable, '-c', RUN, str(ROOT / 'launch' / name), *arguments]
    with (
        log.open('w') as output,
        subprocess.Popen(
            command,
            cwd=prefix,  # elsewhere, launch/ of the source would be in the way
            env=environment,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process,
    ):
        try:
            yield log
            process.send_signal(signal.SIGINT)
            assert process.wait(END_SEC) == 0, log.read_text()
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    assert 'process has died' not in log.read_text()
    assert 'Traceback' not in log.read_text()


@pytest.fixture
def loud(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def test_the_simulation_drives_and_leaves_a_bag(prefix: Path, loud: None) -> None:
    domain = next_domain()
    arguments = ('namespace:=r', 'camera_size:=640x480', f'record:={prefix}/bag')
    with Bench(domain) as bench, launched(prefix, domain, 'simulation.launch.py', *arguments):
        phases = bench.listen(String, 'r/phase', qos.LATCHED)
        bench.until(
            lambda: any(message.data == 'displacing' for message in phases),
            'the robot to set off',
            START_SEC,
        )
    assert (prefix / 'bag/metadata.yaml').is_file()


def test_on_a_robot_the_servo_waits_to_be_started(prefix: Path, loud: None) -> None:
    domain = next_domain()
    with Bench(domain) as bench, launched(prefix, domain, 'robot.launch.py', 'image:=/eye'):
        phases = bench.listen(String, 'phase', qos.LATCHED)
        bench.until(lambda: bool(phases), 'the servo', START_SEC)
        bench.until(
            lambda: bench.probe.count_subscribers('/eye') == 1, 'the tracker to look', START_SEC
        )
        assert bench.call('servo_node/stop').success
    assert {message.data for message in phases} == {'waiting'}
