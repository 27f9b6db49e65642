"""A listener that hangs: a process that is stopped acknowledges nothing it is told."""

from collections.abc import Callable
from contextlib import ExitStack
import signal
import subprocess
import sys
import time
from typing import Any

from node_process import environment
import pytest

# What is acknowledged takes milliseconds; one that hangs is given up by DDS after 20 s.
SOON_SEC, LATE_SEC = 0.1, 5.0

CODE = """
from importlib import import_module
import sys
import rclpy

module, kind, topic = sys.argv[1:]
rclpy.init(args=[])
node = rclpy.create_node('listener')
node.create_subscription(getattr(import_module(module), kind), topic, lambda message: None, 1)
print('listens', flush=True)
rclpy.spin(node)
"""


class FrozenListener:
    """A process that listens to ``topic``, until it is frozen."""

    def __init__(self, stack: ExitStack, domain: int, kind: type[Any], topic: str) -> None:
        command = [sys.executable, '-c', CODE, kind.__module__, kind.__name__, topic]
        self._process = stack.enter_context(
            subprocess.Popen(command, env=environment(domain), stdout=subprocess.PIPE, text=True)
        )
        stack.callback(self._process.kill)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == 'listens\n'

    def freeze(self) -> None:
        self._process.send_signal(signal.SIGSTOP)


def assert_waits(last_word: Callable[[], object]) -> None:
    """Let a node say its last word to one that hangs: it waits for it, but not for ever."""
    began = time.monotonic()
    last_word()
    took = time.monotonic() - began
    if not SOON_SEC < took < LATE_SEC:
        pytest.fail(f'it waited {took:.3f} s for a listener that hangs')
