"""Executor of a process: rclpy's own; nodes that no other process sees."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.subscription import Subscription

from visual_servo_epipolar.nodes import parameters
from visual_servo_epipolar.nodes.startup.process import discovery_range, tune_transport


def new_executor(context: Context | None = None, *, with_info: bool = False) -> Executor:
    """
    Return an executor, to be spun by ``spin_once`` with a timeout in a loop.

    That of events spends a tenth of the time of the other on a message. Its ``spin`` never
    returns, and a subscription that asks for the info of a message, ``with_info``, breaks it.
    """
    try:
        from rclpy.experimental import EventsExecutor  # since rclpy 7.1.4
    except ImportError:
        with_info = True
    return (
        SingleThreadedExecutor(context=context) if with_info else EventsExecutor(context=context)
    )


def spin_once(executor: Executor, timeout_sec: float) -> None:
    """Call back for what is ready within ``timeout_sec`` [s], but for events of what is gone."""
    with suppress(InvalidHandle):  # a callback's own is logged by the executor
        executor.spin_once(timeout_sec=timeout_sec)


def hand_out(subscription: Subscription) -> bool:
    """Call back for the next message that waits, a raw one with its info; False of none."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:  # another callback has just destroyed it
        return False
    if taken is None:
        return False
    subscription.callback(*taken if subscription.raw else taken[:1])
    return True


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
