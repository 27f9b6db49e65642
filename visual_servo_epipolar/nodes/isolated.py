"""Real nodes in this process alone: what lockstep, the world of faults and listeners share."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from typing import Any

import rclpy
from rclpy.context import Context

from visual_servo_epipolar.nodes import parameters
from visual_servo_epipolar.nodes.startup.process import discovery_range, tune_transport


@contextmanager
def isolated_context(reach: str = 'OFF', *, domain_id: int | None = None) -> Iterator[Context]:
    """
    Yield a context whose nodes are seen within ``reach`` only: OFF, LOCALHOST or SUBNET.

    Isolation matters: they publish cmd_vel, and there may be a robot in the room.
    """
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


def values_of(settings: Any) -> dict[str, Any]:
    """Return the parameters that ``settings``, a dataclass, stand for."""
    return {item.name: getattr(settings, item.name) for item in fields(settings)}
