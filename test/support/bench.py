"""A bench for nodes: a context in a domain of its own, and a probe that listens and talks."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
import fcntl
from functools import cache
import gc
import itertools
import os
from pathlib import Path
import tempfile
import time
from typing import Any

import pytest
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import ListParameters
import rclpy
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from visual_servo_epipolar.nodes import parameters
from visual_servo_epipolar.nodes.startup.run import new_executor, spin_once

DOMAINS_A_PROCESS, MAX_DOMAIN = 10, 100  # ports of domains above lie among those of the kernel
USUAL_SEC = 30.0  # many times what anything here takes, also beside other work
LONGEST_TURN_SEC = 1.0  # of a wait that counts: the rest is the machine standing still
# Deep enough for seconds of the fastest topic, where the machine stands still meanwhile.
RELIABLE = QoSProfile(depth=300, reliability=ReliabilityPolicy.RELIABLE)
# As nodes publish on it: what one says while it is made reaches a probe that is matched later.
ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@cache
def _domains() -> Iterator[int]:
    """Cycle through domain ids that no other process on this machine tests in."""
    for first in range(1, MAX_DOMAIN, DOMAINS_A_PROCESS):
        path = Path(tempfile.gettempdir(), f'visual_servo_test_domain_{first}.lock')
        lock = os.open(path, os.O_CREAT | os.O_RDONLY, 0o644)  # open until this process ends
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return itertools.cycle(range(first, first + DOMAINS_A_PROCESS))
        os.close(lock)
    pytest.fail(f'at most {MAX_DOMAIN // DOMAINS_A_PROCESS} processes can test at a time')


def next_domain() -> int:
    """Return a domain id that nobody else uses at the time."""
    return next(_domains())


def spin_until(
    executor: Any, condition: Callable[[], bool], timeout_sec: float, waiting_for: str
) -> None:
    """Spin until ``condition``; fail naming what was waited for if that takes too long."""
    left_sec = timeout_sec
    while not condition():
        if left_sec <= 0.0:
            pytest.fail(f'waited {timeout_sec:g} s in vain for {waiting_for}')
        began = time.monotonic()
        executor.spin_once(timeout_sec=0.02)
        left_sec -= min(time.monotonic() - began, LONGEST_TURN_SEC)


class Spinner:
    """Executors of nodes that run in one thread here, and in a process each otherwise."""

    def __init__(self, context: Context) -> None:
        self._executors = [new_executor(context, with_info=each) for each in (False, True)]
        self._recorders = 0

    def add_node(self, node: Node) -> None:
        with_info = getattr(node, 'with_info', False)
        self._executors[with_info].add_node(node)
        self._recorders += with_info

    def remove_node(self, node: Node) -> None:
        with_info = getattr(node, 'with_info', False)
        self._executors[with_info].remove_node(node)
        self._recorders -= with_info

    def spin_once(self, timeout_sec: float) -> None:
        if self._recorders:
            spin_once(self._executors[True], 0.0)
            timeout_sec = min(timeout_sec, 0.001)
        spin_once(self._executors[False], timeout_sec)

    def shutdown(self) -> None:
        for executor in self._executors:
            executor.shutdown()


class Bench(AbstractContextManager['Bench']):
    """Nodes under test and a probe in one context; all is destroyed at the end."""

    def __init__(self, domain_id: int | None = None) -> None:
        self.context = Context()
        rclpy.init(args=[], context=self.context, domain_id=domain_id or next_domain())
        self.executor = Spinner(self.context)
        self.nodes: list[Node] = []
        self._refused = False  # whether a node did not start
        self._clients: dict[tuple[str, Any], Client] = {}
        self.probe = self.add(rclpy.create_node('probe', context=self.context))
        self.logs: list[Log] = self.listen(Log, '/rosout', ROSOUT)

    def __exit__(self, *_: object) -> None:
        for node in self.nodes:
            node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()
        if self._refused:
            # Half a node, when it goes, takes /rosout from one of its name: not from the next's.
            gc.collect()

    def add(self, node: Any) -> Any:
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def remove(self, node: Any) -> None:
        """Destroy a node before the end."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def start(self, kind: Callable[..., Any], **values: Any) -> Any:
        """Start a node of ``kind`` with parameters, and wait until it knows the probe."""
        overrides = [parameters.override(name, value) for name, value in values.items()]
        try:
            node = kind(
                context=self.context, parameter_overrides=overrides, use_global_arguments=False
            )
        except BaseException:
            self._refused = True
            raise
        self.add(node)
        self.until(self._joined, 'publishers and subscribers to find each other')
        return node

    def listen(self, kind: Any, topic: str, profile: QoSProfile = RELIABLE) -> list[Any]:
        """Return the list that messages on ``topic`` will be appended to."""
        heard: list[Any] = []
        self.probe.create_subscription(kind, topic, heard.append, profile)
        return heard

    def talk(self, kind: Any, topic: str, profile: QoSProfile = RELIABLE) -> Callable[[Any], None]:
        """Return the function that publishes on ``topic``."""
        publisher = self.probe.create_publisher(kind, topic, profile)
        return publisher.publish  # type: ignore[no-any-return]

    def call(self, service: str, kind: Any = Trigger, request: Any = None) -> Any:
        """Call a service and return its response."""
        # One client for all calls: a server drops the answer to one that it does not know yet.
        if (service, kind) not in self._clients:
            self._clients[service, kind] = self.probe.create_client(kind, service)
        client = self._clients[service, kind]
        self.until(client.service_is_ready, f'service {service}')
        future = client.call_async(request or kind.Request())
        self.until(future.done, f'the answer of {service}')
        return future.result()

    def until(
        self, condition: Callable[[], bool], waiting_for: str, timeout_sec: float = USUAL_SEC
    ) -> None:
        spin_until(self.executor, condition, timeout_sec, waiting_for)

    def pass_time(self, seconds: float) -> None:
        """Spin for so long."""
        end_s = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end_s, 'time to pass')

    def settle(self) -> None:
        """Let everything that is on its way arrive: a round trip to every node, twice."""
        for _ in range(2):
            for node in self.nodes:
                self.call(f'{node.get_name()}/list_parameters', ListParameters)

    def logged(self, text: str) -> list[str]:
        """Return what was logged with ``text`` in it."""
        return [log.msg for log in self.logs if text in log.msg]

    def _joined(self) -> bool:
        return all(self._known(item) for node in self.nodes for item in node.publishers)

    def _known(self, publisher: Any) -> bool:
        topic = publisher.topic_name
        ears = [item for node in self.nodes for item in node.subscriptions]
        count = publisher.get_subscription_count()
        return bool(count >= sum(ear.topic_name == topic for ear in ears))
