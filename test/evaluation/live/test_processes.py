"""Processes of an evaluation end with it, also where a signal ends it that it cannot hear."""

from collections.abc import Callable
from contextlib import ExitStack, suppress
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip('rclpy')

from node_process import environment

from visual_servo_epipolar.evaluation.live.processes import DOMAIN

START_SEC, END_SEC = 60.0, 8.0
SIGNALS = ['SIGTERM', 'SIGKILL']
# Nodes whose session is their own, and who print to where this one prints.
NODES = """
from contextlib import ExitStack
from pathlib import Path
import sys

from visual_servo_epipolar.commands.ending import terminable
from visual_servo_epipolar.evaluation.live import echo
from visual_servo_epipolar.evaluation.live.processes import start_nodes

with terminable(), ExitStack() as stack:
    (node,) = start_nodes(stack, {echo.__name__: ()}, Path(sys.argv[1]), logs=True).values()
    print(node.pid, flush=True)
    node.wait()
"""
# From far away: by itself it would not end before the test has.
DEMO = """
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.evaluation.benchmarks.speed import demo

demo.SHORT = demo.LONG
main(['bench', 'loop'])
"""


def begin(stack: ExitStack, *command: str) -> 'subprocess.Popen[bytes]':
    process = stack.enter_context(
        subprocess.Popen(
            [sys.executable, '-c', *command],
            env=environment(DOMAIN),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    )
    stack.callback(process.kill)
    return process


def session_of(process: 'subprocess.Popen[bytes]') -> list[int]:
    """Return the processes that run in its session."""
    running = []
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            state, _, _, session = path.read_text().rpartition(')')[2].split()[:4]
        except OSError:  # it has ended meanwhile
            continue
        if int(session) == process.pid and state != 'Z':
            running.append(int(path.parent.name))
    return running


def kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def comes_true(condition: Callable[[], bool], within_sec: float) -> bool:
    deadline = time.monotonic() + within_sec
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)
    return condition()


@pytest.mark.parametrize('number', SIGNALS)
def test_nodes_end_with_who_started_them(number: str, tmp_path: Path) -> None:
    with ExitStack() as stack:
        process = begin(stack, NODES, str(tmp_path))
        assert process.stdout is not None
        stack.callback(kill, int(process.stdout.readline()))
        process.send_signal(signal.Signals[number])
        assert process.communicate(timeout=END_SEC) == (b'', None)  # closed by the node as well


@pytest.mark.parametrize('number', SIGNALS)
def test_the_demo_and_its_processes_end_with_the_benchmark(number: str) -> None:
    with ExitStack() as stack:
        process = begin(stack, DEMO)
        stack.callback(lambda: [kill(pid) for pid in session_of(process)])
        # The benchmark, the demo, and one that draws for it.
        assert comes_true(lambda: len(session_of(process)) >= 3, START_SEC)
        process.send_signal(signal.Signals[number])
        assert comes_true(lambda: not session_of(process), END_SEC)
