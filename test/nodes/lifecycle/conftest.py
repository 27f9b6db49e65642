"""A managed node that does a little of everything, and fails where it is told to."""

from collections.abc import Callable
from typing import Any

import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.lifecycle.gates import in_every_state
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode
from visual_servo_epipolar.nodes.startup.settings import LifecycleSettings

PERIOD_S = 0.01


class Parrot(ManagedNode):
    """Repeats what it hears, ticks, and says in which part of its life it is."""

    def __init__(self, **options: Any) -> None:
        super().__init__('parrot', **options)
        self.fails: dict[str, Exception] = {}
        self.calls: list[str] = []
        self.heard: list[str] = []
        self.ticks = 0
        self.later: Any = None
        self.create_service(Trigger, '~/talk', self._on_talk)
        self.create_service(Trigger, '~/hush', self._on_hush)
        self.autostart(parameters.declare(self, LifecycleSettings))

    def configure(self) -> None:
        self.words = self.create_publisher(String, 'words', 10)
        self.mood = self.create_publisher(String, 'mood', qos.LATCHED)
        self.create_subscription(String, 'said', self._hear, qos.STREAM)
        self.create_subscription(String, 'name', self._hear, qos.LATCHED)
        self.create_timer(PERIOD_S, self._on_tick)
        self.create_client(Trigger, 'nobody')
        self._live('configure')

    def activate(self) -> None:
        self._live('activate')
        for _ in range(2):  # the first is what somebody replaces in mid-life
            more = self.create_subscription(String, 'more', self._hear, qos.STREAM)
            if self.later is not None:
                self.destroy_subscription(self.later)
            self.later = more

    def deactivate(self) -> None:
        self._live('deactivate')

    def cleanup(self) -> None:
        self.later = None
        self._live('cleanup')

    def _live(self, part: str) -> None:
        self.calls.append(part)
        self.mood.publish(write.text(part))
        self.words.publish(write.text(part))
        if part in self.fails:
            raise self.fails[part]

    def _hear(self, message: String) -> None:
        self.heard.append(message.data)
        self.words.publish(message)

    def _on_tick(self) -> None:
        self.ticks += 1

    def _on_talk(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, 'hello'
        return response

    @in_every_state
    def _on_hush(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, 'silent'
        return response


@pytest.fixture
def parrot(bench) -> Callable[..., Parrot]:
    """Return how to start one; unconfigured unless told otherwise."""

    def start(*, autostart_node: bool = False, **values: Any) -> Parrot:
        node: Parrot = bench.start(Parrot, autostart_node=autostart_node, **values)
        return node

    return start
