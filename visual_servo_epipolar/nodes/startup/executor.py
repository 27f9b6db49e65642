"""Executor of a process: messages by a wait that costs little; nodes that nobody else sees."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, ExitStack
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

from visual_servo_epipolar.nodes import parameters
from visual_servo_epipolar.nodes.startup.process import discovery_range, tune_transport

WITH_INFO = Subscription.CallbackType.WithMessageInfo
# After which events, actions and guards are looked at as well, and tasks that wait for something.
LOOK_S, TASK_S = 0.05, 0.02
# What is waited for, in the order of the sizes of a wait set, and where a node has it.
KINDS = {
    'subscription': 'subscriptions',
    'timer': 'timers',
    'client': 'clients',
    'service': 'services',
}
NANOSECONDS = 1e9


def hand_out(subscription: Subscription) -> bool:
    """Call back for the next message that waits, and return whether there was one."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:  # another callback has just destroyed it
        return False
    if taken is None:
        return False
    with_info = subscription._callback_type is WITH_INFO
    subscription.callback(*taken if with_info else taken[:1])
    return True


class MessageExecutor(SingleThreadedExecutor):
    """
    Calls back for messages as they come, and leaves timers, services and all else to rclpy.

    rclpy fills a wait set with every entity of a node, and with the events of each, four to five
    times a message: several milliseconds of a frame. Here it is filled once a wait, and callbacks
    of subscriptions, which are plain functions, are no tasks. All run one by one, in the thread
    that spins; what was due before a message comes before it.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._wait_set: Any = None
        self._sizes: list[int] = []
        self._look_at, self._looks = 0.0, False

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Run what is ready, or becomes so within ``timeout_sec`` [s], or until the next look."""
        wait_s = self._look_at - time.monotonic()
        if wait_s <= 0.0:
            self._look()
            wait_s = 0.0  # what it has run may be what somebody waits for
        elif timeout_sec is not None and timeout_sec >= 0.0:
            wait_s = min(wait_s, timeout_sec)
        subscriptions, others = self._ready(wait_s)
        if others:
            self._look()
        for item in subscriptions:
            hand_out(item)

    def can_execute(self, entity: Any) -> bool:
        """Return whether to wait for ``entity``; for no message by rclpy, which takes longer."""
        if self._looks and isinstance(entity, Subscription):
            return False
        return bool(super().can_execute(entity))

    def _look(self) -> None:
        """Run all that is ready but messages, once, by a wait set of rclpy's."""
        self._looks = True
        try:
            while True:
                try:
                    task, _, _ = self.wait_for_ready_callbacks(timeout_sec=0.0)
                except (TimeoutException, ShutdownException):
                    break
                task()
                task.result()  # raises what it raised
        finally:
            self._looks = False
        self._look_at = time.monotonic() + (TASK_S if self._has_tasks() else LOOK_S)

    def _has_tasks(self) -> bool:
        """Return whether a task waits for something; one that is done is kept for a while."""
        return any(not task.done() for task, _, _ in self._tasks)

    def _ready(self, wait_s: float) -> tuple[list[Subscription], bool]:
        """Return the subscriptions that have a message, and whether anything else is ready."""
        nodes = self.get_nodes()
        entities = {
            kind: [
                item for node in nodes for item in getattr(node, where) if self.can_execute(item)
            ]
            for kind, where in KINDS.items()
        }
        wait_set = self._wait_set_for([len(items) for items in entities.values()])
        with ExitStack() as held:  # nobody destroys them meanwhile
            held.enter_context(self._guard.handle)
            wait_set.add_guard_condition(self._guard.handle)  # who wakes it has given it a task
            for kind, items in entities.items():
                add = getattr(wait_set, f'add_{kind}')
                for item in items:
                    try:
                        held.enter_context(item.handle)
                    except InvalidHandle:
                        continue
                    add(item.handle)
            wait_set.wait(round(wait_s * NANOSECONDS))
            ready = {kind: set(wait_set.get_ready_entities(kind)) for kind in KINDS}
            messages = ready.pop('subscription')
            subscriptions = [
                item
                for item in entities['subscription']
                if messages and item.handle.pointer in messages
            ]
        return subscriptions, self._has_tasks() or any(ready.values())

    def _wait_set_for(self, sizes: list[int]) -> Any:
        """Return a wait set that is empty, with room for so many entities of each of KINDS."""
        if sizes != self._sizes:
            subscriptions, *others = sizes
            self._wait_set = rclpy_implementation.WaitSet(
                subscriptions, 1, *others, 0, self._context.handle
            )
            self._sizes = sizes
        self._wait_set.clear_entities()
        return self._wait_set


@contextmanager
def isolated_context(reach: str = 'OFF', *, domain_id: int | None = None) -> Iterator[Context]:
    """Yield a context seen within ``reach`` only: its nodes must not drive a robot in the room."""
    tune_transport()
    with discovery_range(reach):
        context = Context()
        rclpy.init(args=[], context=context, domain_id=domain_id)
        try:
            yield context
        finally:
            context.try_shutdown()


def new_node(kind: Any, context: Context, values: Mapping[str, Any], *, name: str = '') -> Any:
    """Return a node of ``kind`` with these parameters, under another ``name`` if one is given."""
    return kind(
        context=context,
        parameter_overrides=[parameters.override(*each) for each in values.items()],
        use_global_arguments=False,
        **({'cli_args': ['--ros-args', '-r', f'__node:={name}']} if name else {}),
    )
