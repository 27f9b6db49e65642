"""The four nodes as four processes in wall time, as on a robot; and what happens if one dies."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
import re
import signal
import subprocess

from bench import Bench, next_domain
from durations import few_of
from nav_msgs.msg import Odometry
from node_process import arguments, environment
import pytest
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config'
NODES = ('unicycle_node', 'camera_node', 'tracker_node', 'servo_node')
START = ('-p', 'start:=[0.2, -1.6, 0.0]')
ARRIVE_SEC, MOVE_SEC, END_SEC = 150.0, 60.0, 30.0
COMMAND_TIMEOUT_SEC, BRAKING_SEC = 0.5, 0.4 / 0.6  # from 0.4 m/s at 0.6 m/s^2


class Team:
    """The four nodes as processes, and a bench in this one that hears them."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        domain = next_domain()
        self.bench = stack.enter_context(Bench(domain))
        self.truth = self.bench.listen(Odometry, 'ground_truth')
        self.phases = self.bench.listen(String, 'phase', qos.LATCHED)
        self.processes, self._folder = {}, folder
        for name in NODES:
            files = ['--params-file', str(CONFIG / f'{name}.yaml')]
            if name == 'camera_node':
                files += ['--params-file', str(CONFIG / 'camera_node_640x480.yaml')]
            command = arguments(name, *files, *(START if name == 'unicycle_node' else ()))
            log = stack.enter_context((folder / name).open('w'))
            # A session of its own: it must not inherit an ignored SIGINT.
            self.processes[name] = stack.enter_context(
                subprocess.Popen(
                    command, env=environment(domain), stderr=log, start_new_session=True
                )
            )
            stack.callback(self.processes[name].kill)

    def output(self, name: str) -> str:
        return (self._folder / name).read_text()

    def speed(self) -> float:
        return abs(read.twist(self.truth[-1].twist).linear) if self.truth else 0.0

    def at_speed(self) -> 'Team':
        self.bench.until(lambda: self.speed() > 0.15, 'the robot to drive', MOVE_SEC)
        return self

    def standstill_after_ns(self) -> int:
        """Return how long the robot moves from now on, by the stamps of ground truth [ns]."""
        began = read.stamp_ns(self.truth[-1].header)
        stands = lambda: read.twist(self.truth[-1].twist) == STANDSTILL  # noqa: E731
        self.bench.until(stands, 'a standstill', END_SEC)
        return read.stamp_ns(self.truth[-1].header) - began


@pytest.fixture
def team(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Team]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with ExitStack() as stack:
        yield Team(stack, tmp_path)


@pytest.mark.alone
def test_four_processes_bring_the_robot_home(team) -> None:
    team.bench.until(
        lambda: bool(team.phases) and team.phases[-1].data in ('arrived', 'failed'),
        'the run to end',
        ARRIVE_SEC,
    )
    assert team.phases[-1].data == 'arrived', team.output('servo_node')
    team.standstill_after_ns()
    pose = read.pose(team.truth[-1])
    assert pose.distance < 0.03
    assert abs(pose.heading_error) < 0.0175  # one degree


@pytest.mark.alone
def test_the_base_stops_when_the_servo_is_killed(team) -> None:
    team.at_speed()
    team.processes['servo_node'].kill()
    # A command may be on its way, and ticks of the base late on a busy machine: 0.3 s more.
    assert team.standstill_after_ns() < (COMMAND_TIMEOUT_SEC + BRAKING_SEC + 0.3) * 1e9
    assert team.processes['servo_node'].wait(END_SEC) == -signal.SIGKILL


def run_badly(name: str, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        arguments(name, *more),
        env=environment(next_domain()),
        capture_output=True,
        text=True,
        timeout=END_SEC,
    )


@pytest.mark.parametrize(
    ('text', 'reason'),
    few_of(
        [
            ('{max_linear: 99.0}', 'max_linear out of range'),
            ('{max_linear: 2}', "'INTEGER', expecting type 'DOUBLE'"),
            ('{max_linear: .nan}', 'max_linear'),
            ('{max_linea: 0.1}', 'no parameter max_linea; did you mean max_linear'),
            ('{law: other}', 'law must be one of paper, corrected, full'),
            ('{latch_engage: 0.1}', 'latch_engage must not exceed latch_release'),
        ],
        keep=(3,),
    ),
)
def test_a_bad_setting_ends_a_node_with_one_line(tmp_path, text, reason) -> None:
    file = tmp_path / 'servo_node.yaml'
    file.write_text(f'servo_node: {{ros__parameters: {text}}}')
    ended = run_badly('servo_node', '--params-file', str(file))
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1, ended.stderr
    assert ended.stderr.startswith('servo_node')
    assert re.search(reason, ended.stderr), ended.stderr


@pytest.mark.parametrize(
    'text', few_of(['servo_node: {ros__parameters: {k1: [}', None, 'servo_node: 1'])
)
def test_a_file_that_is_no_parameter_file_ends_a_node_with_one_line(tmp_path, text) -> None:
    file = tmp_path / 'servo_node.yaml'
    if text is not None:
        file.write_text(text)
    ended = run_badly('servo_node', '--params-file', str(file))
    assert ended.returncode == 2
    ours = [line for line in ended.stderr.splitlines() if '[rcl]' not in line]
    assert len(ours) == 1, ended.stderr
    assert str(file) in ours[0]


def test_a_blank_photograph_ends_the_tracker_with_one_line(tmp_path) -> None:
    file = tmp_path / 'blank.pgm'
    file.write_bytes(b'P5 64 48 255\n' + bytes(64 * 48))
    ended = run_badly('tracker_node', '-p', f'desired_image:={file}')
    assert ended.returncode == 2
    assert len(ended.stderr.splitlines()) == 1, ended.stderr
    assert 'shows 0 features' in ended.stderr
