"""Nodes as processes in wall time: four bring a robot home; refused in a line, led, ended."""

from contextlib import ExitStack
from itertools import count
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from bench import Bench, next_domain
from durations import few_of
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from lifecycles import asked
from nav_msgs.msg import Odometry
from node_process import arguments, environment, started
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import read, write
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
            self.processes[name] = started(stack, environment(domain), command, folder / name)

    def output(self, name: str) -> str:
        return (self._folder / name).read_text()

    def speed(self) -> float:
        return abs(read.twist(self.truth[-1].twist).linear) if self.truth else 0.0

    def standstill_after_ns(self) -> int:
        """Return how long the robot moves from now on, by the stamps of ground truth [ns]."""
        began = read.stamp_ns(self.truth[-1].header)
        stands = lambda: read.twist(self.truth[-1].twist) == STANDSTILL  # noqa: E731
        self.bench.until(stands, 'a standstill', END_SEC)
        return read.stamp_ns(self.truth[-1].header) - began


@pytest.mark.alone
def test_four_processes_bring_the_robot_home(stack, tmp_path) -> None:
    team = Team(stack, tmp_path)
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
def test_the_base_stops_when_the_servo_is_killed(stack, tmp_path) -> None:
    team = Team(stack, tmp_path)
    team.bench.until(lambda: team.speed() > 0.15, 'the robot to drive', MOVE_SEC)
    team.processes['servo_node'].kill()
    # A command may be on its way, and ticks of the base late on a busy machine: 0.3 s more.
    assert team.standstill_after_ns() < (COMMAND_TIMEOUT_SEC + BRAKING_SEC + 0.3) * 1e9
    assert team.processes['servo_node'].wait(END_SEC) == -signal.SIGKILL


SERVO, TRACKER = ('servo_node', '--params-file', ''), ('tracker_node', '-p', 'desired_image:=')
BAD = [
    (
        SERVO,
        b'servo_node: {ros__parameters: {max_linear: 2}}',
        "'INTEGER', expecting type 'DOUBLE'",
    ),
    (SERVO, b'servo_node: {ros__parameters: {max_linea: 0.1}}', 'did you mean max_linear'),
    (SERVO, b'servo_node: {ros__parameters: {k1: [}', '{file}'),
    (SERVO, None, '{file}'),
    (SERVO, b'servo_node: 1', '{file}'),
    (TRACKER, b'P5 64 48 255\n' + bytes(64 * 48), 'shows 0 features'),
]


@pytest.mark.parametrize(('node', 'content', 'reason'), few_of(BAD, keep=(1, 2, 5)))
def test_what_cannot_be_used_ends_a_node_with_one_line(tmp_path, node, content, reason) -> None:
    file, (name, option, value) = tmp_path / 'given', node
    if content is not None:
        file.write_bytes(content)
    ended = subprocess.run(
        arguments(name, option, f'{value}{file}'),
        env=environment(next_domain()),
        capture_output=True,
        text=True,
        timeout=END_SEC,
    )
    ours = [line for line in ended.stderr.splitlines() if '[rcl]' not in line]
    assert (ended.returncode, len(ours)) == (2, 1), ended.stderr
    assert ours[0].startswith(name) and reason.format(file=file) in ours[0]


MANAGED = ('servo_node', 'tracker_node', 'recorder_node', 'dock_node', 'route_node')


def assert_ends(process: Any, log: Path) -> None:
    assert process.wait(END_SEC) == 0, log.read_text()
    assert 'Traceback' not in log.read_text()


def test_a_process_survives_the_impossible_and_ends_in_any_state(stack, tmp_path) -> None:
    domain = next_domain()
    bench, processes = stack.enter_context(Bench(domain)), {}
    for name in MANAGED:
        command = arguments(name, '-p', 'autostart_node:=false')
        processes[name] = started(stack, environment(domain), command, tmp_path / name)
    for place, name in enumerate(MANAGED):  # one ends unconfigured, one inactive, others active
        for number in (99, 3, *(1, 1, 3, 3)[: 2 * place]):
            bench.call(f'{name}/change_state', ChangeState, asked(number))
        state = bench.call(f'{name}/get_state', GetState).current_state.label
        assert state == ('unconfigured', 'inactive', 'active', 'active', 'active')[place]
        processes[name].send_signal(signal.SIGINT)
        assert_ends(processes[name], tmp_path / name)


@pytest.mark.parametrize('name', few_of(MANAGED))
def test_shutdown_ends_the_process(stack, tmp_path, name) -> None:
    domain, log = next_domain(), tmp_path / 'log'
    bench = stack.enter_context(Bench(domain))
    process = started(stack, environment(domain), arguments(name), log)
    request = asked(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert bench.call(f'{name}/change_state', ChangeState, request).success
    assert_ends(process, log)


@pytest.mark.long
def test_each_of_200_signals_ends_a_tracker_that_loads_or_tracks(
    stack, tmp_path, simulator, view
) -> None:
    domain, stops, log = next_domain(), 200, tmp_path / 'log'
    load = 'from visual_servo_epipolar.nodes.startup.executables import tracker_node as run; run()'
    bench, stamps = stack.enter_context(Bench(domain)), count(1)
    clouds = bench.listen(PointCloud2, 'tracks')
    camera, images = bench.talk(CameraInfo, 'camera_info'), bench.talk(Image, 'image_raw')

    def see() -> None:
        camera(write.camera_info(simulator.camera, stamp := next(stamps), 'camera'))
        images(write.image(view, 'mono8', stamp, 'camera'))

    bench.probe.create_timer(0.03, see)
    began = time.monotonic()
    for number in range(stops):
        with ExitStack() as own:
            process = started(own, environment(domain), [sys.executable, '-c', load], log)
            if number == 0:
                bench.until(lambda: bool(clouds), 'tracks', MOVE_SEC)
                loading_s = time.monotonic() - began
            end = time.monotonic() + 1.3 * loading_s * number / stops
            bench.until(lambda end=end: time.monotonic() >= end, 'its time', MOVE_SEC)
            process.terminate()
            # Python itself has no handler yet, and none any more.
            assert process.wait(END_SEC) in (0, -signal.SIGTERM), log.read_text()
