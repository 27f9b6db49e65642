"""Build the package with colcon, as a ROS workspace does, and run what that installed."""

from contextlib import ExitStack
from dataclasses import dataclass
import os
from pathlib import Path
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

from bench import Bench, next_domain
from node_process import started
import pytest

from visual_servo_epipolar.nodes.startup.table import NODES

ROOT = Path(__file__).parents[2]
NAME = 'visual_servo_epipolar'
DOMAIN = next_domain()
START_SEC, STOP_SEC = 60.0, 30.0  # more than ten times what they take

pytestmark = [pytest.mark.colcon, pytest.mark.long]


@dataclass(frozen=True)
class Workspace:
    """A built workspace, and the environment of a shell that has sourced it."""

    path: Path
    environment: dict[str, str]

    @property
    def executables(self) -> Path:
        return self.path / 'install' / NAME / 'lib' / NAME

    @property
    def share(self) -> Path:
        return self.path / 'install' / NAME / 'share'


@pytest.fixture(scope='module', params=['copied', 'symlinked'])
def workspace(request, tmp_path_factory) -> Workspace:
    path = tmp_path_factory.mktemp(request.param)
    colcon(path, 'build', *(['--symlink-install'] if request.param == 'symlinked' else []))
    return Workspace(path, sourced(path))


def colcon(path: Path, verb: str, *arguments: str) -> None:
    """Run colcon on this package alone; whatever it makes goes into the workspace ``path``."""
    places = ['--build-base', str(path / 'build'), '--install-base', str(path / 'install')]
    ran = subprocess.run(
        [sys.executable, '-m', 'colcon', '--log-base', str(path / 'log'), verb]
        + ['--paths', str(ROOT), *places, *arguments],
        cwd=path,
        env=ros_environment(),
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, f'colcon {verb} failed:\n{ran.stdout}\n{ran.stderr}'


def ros_environment() -> dict[str, str]:
    """Return the environment of a shell that has sourced ROS, in a domain of its own."""
    return {
        'AMENT_PREFIX_PATH': sys.prefix,  # of the wheels; a native ROS has set its own
        **os.environ,
        'ROS_DOMAIN_ID': str(DOMAIN),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


def sourced(path: Path) -> dict[str, str]:
    """Return the environment of a shell after `. install/setup.bash`."""
    ran = subprocess.run(
        ['bash', '-c', '. install/setup.bash && env -0'],
        cwd=path,
        env=ros_environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(entry.split('=', 1) for entry in ran.stdout.split('\0') if entry)


def files(folder: Path) -> set[Path]:
    """Return all files below ``folder``, as paths from there, but for Python's own caches."""
    paths = (path.relative_to(folder) for path in folder.rglob('*') if path.is_file())
    return {path for path in paths if '__pycache__' not in path.parts}


def test_executables_lie_where_ros2_run_looks(workspace: Workspace) -> None:
    names = {path.name for path in workspace.executables.iterdir()}
    assert names == {'visual_servo', *NODES}


def test_the_ament_index_knows_the_package(workspace: Workspace) -> None:
    assert (workspace.share / 'ament_index/resource_index/packages' / NAME).is_file()
    assert (workspace.share / NAME / 'package.xml').is_file()


@pytest.mark.parametrize('folder', ['config', 'launch'])
def test_all_of_a_folder_is_shared(folder: str, workspace: Workspace) -> None:
    assert files(workspace.share / NAME / folder) == files(ROOT / folder)


def test_the_whole_package_is_imported_from_the_workspace(workspace: Workspace, tmp_path) -> None:
    completed = subprocess.run(
        [sys.executable, '-c', f'import {NAME}; print({NAME}.__path__[0])'],
        cwd=tmp_path,
        env=workspace.environment,
        capture_output=True,
        text=True,
        check=True,
    )
    imported = Path(completed.stdout.strip())
    assert imported.is_relative_to(workspace.path)
    assert files(imported) == files(ROOT / NAME)


def test_the_installed_command_lists_its_subcommands(workspace: Workspace, tmp_path: Path) -> None:
    ran = subprocess.run(
        [workspace.executables / 'visual_servo', '--help'],
        cwd=tmp_path,
        env=workspace.environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    assert 'demo' in ran.stdout


@pytest.mark.parametrize('name', NODES)
def test_a_node_of_a_namespace_starts_and_ends(name, workspace, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    settings = workspace.share / NAME / 'config' / f'{name}.yaml'
    command = [str(workspace.executables / name), '--ros-args', '-r', '__ns:=/robot1']
    command += ['--params-file', str(settings)]
    log = tmp_path / 'output.txt'
    with ExitStack() as stack:
        bench = stack.enter_context(Bench(DOMAIN))
        process = started(stack, workspace.environment, command, log)

        def runs() -> bool:
            assert process.poll() is None, log.read_text()
            return name in bench.probe.get_node_names()

        bench.until(runs, f'{name} in {log.parent}', START_SEC)
        process.send_signal(signal.SIGINT)
        assert process.wait(STOP_SEC) == 0, log.read_text()
    assert 'Traceback' not in log.read_text()
    assert 'sets no parameter' not in log.read_text()


def test_colcon_test_finds_the_tests(workspace: Workspace) -> None:
    colcon(workspace.path, 'test', '--pytest-args', 'test/packaging/test_metadata.py')
    results = ElementTree.parse(workspace.path / 'build' / NAME / 'pytest.xml').getroot()
    assert sum(int(suite.get('tests', 0)) for suite in results.iter('testsuite')) > 0
