"""Signals that end a servo, as a real process: the robot is told to stand, whatever ends it."""

from collections.abc import Iterator
from contextlib import ExitStack
import os
from pathlib import Path
import signal
import subprocess
import sys

from bench import Bench, next_domain
from geometry_msgs.msg import Twist as TwistMessage
from node_process import arguments, environment, started
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2
from servo_rig import CAMERA, tracks

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import read, write

START_SEC, END_SEC = 60.0, 30.0
DRIVING = ('-p', 'autostart:=true', '-p', 'stale_timeout:=60.0')


class Process:
    """A servo in a process of its own, and a bench that is its tracker and its base."""

    def __init__(self, stack: ExitStack, folder: Path, *prefix: str) -> None:
        domain, self._log = next_domain(), folder / 'log'
        self.bench = stack.enter_context(Bench(domain))
        self.commands = self.bench.listen(TwistMessage, 'cmd_vel')
        self._send = self.bench.talk(PointCloud2, 'tracks')
        self._calibrate = self.bench.talk(CameraInfo, 'camera_info')
        command = [*prefix, *arguments('servo_node', *DRIVING)]
        self.process = started(stack, environment(domain), command, self._log)
        self.bench.until(self.moves, 'a command to move', START_SEC)

    def moves(self) -> bool:
        """Show tracks; return whether a command to move has come."""
        stamp_ns = self.bench.probe.get_clock().now().nanoseconds
        self._calibrate(write.camera_info(CAMERA, stamp_ns, 'camera'))
        self._send(tracks(stamp_ns=stamp_ns))
        return any(read.twist(item) != STANDSTILL for item in self.commands)

    def end_by(self, number: signal.Signals) -> None:
        """Send a signal, and insist on a clean end with a zero twist."""
        self.process.send_signal(number)
        assert self.process.wait(END_SEC) == 0, self._log.read_text()
        assert 'Traceback' not in self._log.read_text()
        self.until_it_stands()

    def until_it_stands(self) -> None:
        stands = lambda: self.commands and read.twist(self.commands[-1]) == STANDSTILL  # noqa: E731
        self.bench.until(stands, 'the zero twist', END_SEC)


@pytest.fixture(autouse=True)
def _heard() -> Iterator[None]:
    """Let children hear signals that this process, run by nohup, may ignore."""
    before = {it: signal.signal(it, signal.SIG_DFL) for it in (signal.SIGHUP, signal.SIGQUIT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    'number',
    [
        'SIGTERM',
        *(pytest.param(each, marks=pytest.mark.long) for each in ('SIGINT', 'SIGHUP', 'SIGQUIT')),
    ],
)
def test_a_servo_that_is_ended_stops_the_robot(stack: ExitStack, tmp_path, number: str) -> None:
    Process(stack, tmp_path).end_by(signal.Signals[number])


def test_a_servo_that_is_suspended_stops_the_robot_first(stack: ExitStack, tmp_path) -> None:
    servo = Process(stack, tmp_path)
    servo.process.send_signal(signal.SIGTSTP)
    servo.until_it_stands()
    assert os.waitid(os.P_PID, servo.process.pid, os.WSTOPPED).si_status == signal.SIGSTOP
    servo.process.send_signal(signal.SIGCONT)
    del servo.commands[:]
    assert servo.bench.call('servo_node/reset').success  # it goes on, and waits for an order
    assert not servo.moves()
    servo.end_by(signal.SIGTERM)


def test_a_servo_started_by_nohup_outlives_its_terminal(stack: ExitStack, tmp_path) -> None:
    servo = Process(stack, tmp_path, 'nohup')
    servo.process.send_signal(signal.SIGHUP)
    for _ in range(3):  # one that ends answers what it has heard already, and no more
        assert servo.bench.call('servo_node/reset').success


# A node that SIGTERM ends as soon as it is made, or a mistake of its own.
SPIN = """
import os, signal
from rclpy.node import Node
from visual_servo_epipolar.nodes.startup.run import spin

class Short(Node):
    def __init__(self, **options):
        super().__init__('short', **options)
        self.create_timer(0.01, self.end)
    def end(self):
        {end}
    def stop(self):
        print('stands', flush=True)

print(spin(Short), flush=True)
os.kill(os.getpid(), signal.SIGTERM)
# A handler in Python would be gone where the interpreter ends, and the default would kill.
print(signal.getsignal(signal.SIGTERM) is signal.SIG_IGN)
"""


def run_short(end: str) -> subprocess.CompletedProcess[str]:
    code = [sys.executable, '-c', SPIN.format(end=end)]
    return subprocess.run(
        code, env=environment(next_domain()), capture_output=True, text=True, timeout=START_SEC
    )


def test_a_second_signal_does_not_end_a_node_that_has_ended() -> None:
    ended = run_short('os.kill(os.getpid(), signal.SIGTERM)')
    assert (ended.returncode, ended.stdout.split('\n')[:3]) == (0, ['stands', '0', 'True'])


def test_a_mistake_in_mid_run_stops_the_robot_and_is_not_hidden() -> None:
    ended = run_short("raise ValueError('a mistake')")
    assert (ended.returncode, ended.stdout) == (1, 'stands\n')
    assert 'Traceback' in ended.stderr
    assert 'ValueError: a mistake' in ended.stderr
