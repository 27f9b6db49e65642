"""Processes of nodes on this machine alone, and a listener to their topics."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import rclpy
from rclpy.node import Node

from visual_servo_epipolar import processes
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.nodes.startup.executor import isolated_context, new_executor, spin_once
from visual_servo_epipolar.threads import ONE_THREAD

# Its own among benchmarks that run at a time, and above those that people use.
DOMAIN = 216 + os.getpid() % 16
NODES = 'visual_servo_epipolar.nodes'

Process = subprocess.Popen[bytes]


def arguments(**values: Any) -> tuple[str, ...]:
    """Return the command line that sets these parameters of a node."""
    return tuple(word for name, value in values.items() for word in ('-p', f'{name}:={value}'))


def start_nodes(
    stack: ExitStack, nodes: Mapping[str, Sequence[str]], folder: Path
) -> dict[str, Process]:
    """
    Start each node of ours, by name, with its arguments in ``folder``.

    They are in sessions of their own, and end with ``stack``, and with this process, however that
    ends.
    """
    own = {'ROS_DOMAIN_ID': str(DOMAIN), 'PYTHONPATH': _import_path()}
    environment = {**ONE_THREAD, **os.environ, **own}  # as executables do
    started = {}
    for name, words in nodes.items():
        command = [sys.executable, '-m', processes.__name__, str(os.getpid()), f'{NODES}.{name}']
        started[name] = stack.enter_context(
            subprocess.Popen(
                [*command, '--ros-args', *words],
                cwd=folder,
                env=environment,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        )
        stack.callback(_end, started[name])
    return started


def _end(process: Process) -> None:
    process.send_signal(signal.SIGCONT)
    process.terminate()
    try:
        process.wait(30.0)  # for a process to end, before it is killed
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _import_path() -> str:
    return os.pathsep.join(filter(None, map(os.path.abspath, sys.path)))


START_S, LOOK_S = 60.0, 0.05


class Listener:
    """Hears what others on this machine publish, until ``stack`` ends."""

    def __init__(self, stack: ExitStack, name: str) -> None:
        context = stack.enter_context(isolated_context('LOCALHOST', domain_id=DOMAIN))
        self.node: Node = rclpy.create_node(name, context=context)
        stack.callback(self.node.destroy_node)
        self._executor = new_executor(context)
        self._executor.add_node(self.node)

    def spin_for(self, seconds: float) -> None:
        """Hear what comes for ``seconds`` [s]."""
        self._spin_until(time.monotonic() + seconds)

    def wait(
        self, condition: Callable[[], bool], complaint: str, timeout_s: float = START_S
    ) -> None:
        """Hear what comes until ``condition``, or raise ``complaint`` after a while."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            self.spin_for(LOOK_S)
            if time.monotonic() > deadline:
                raise VisualServoError(f'{complaint} within {timeout_s:g} s')

    def _spin_until(self, moment: float) -> None:
        while (remaining := moment - time.monotonic()) > 0.0:
            spin_once(self._executor, remaining)
