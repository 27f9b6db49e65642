"""Processes of an evaluation end with it, also where a signal ends it that it cannot hear."""

from contextlib import ExitStack, suppress
import os
import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

from node_process import environment

from visual_servo_epipolar.evaluation.benchmarks.latency import DOMAIN

END_SEC = 8.0
SIGNALS = ['SIGTERM', 'SIGKILL']
# Nodes whose session is their own, and who print to where this one prints.
NODES = """
from contextlib import ExitStack

from visual_servo_epipolar.commands.main import terminable
from visual_servo_epipolar.evaluation.benchmarks.latency import start_nodes

with terminable(), ExitStack() as stack:
    (node,) = start_nodes(stack, {'unicycle_node': ()}).values()
    print(node.pid, flush=True)
    node.wait()
"""


def begin(stack: ExitStack, program: str) -> 'subprocess.Popen[bytes]':
    process = stack.enter_context(
        subprocess.Popen(
            [sys.executable, '-c', program],
            env=environment(DOMAIN),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    )
    stack.callback(process.kill)
    return process


def kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize('number', SIGNALS)
def test_nodes_end_with_the_process_that_started_them(number: str) -> None:
    with ExitStack() as stack:
        process = begin(stack, NODES)
        assert process.stdout is not None
        stack.callback(kill, int(process.stdout.readline()))
        process.send_signal(signal.Signals[number])
        assert process.communicate(timeout=END_SEC) == (b'', None)  # closed by the node as well
