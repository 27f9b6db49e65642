"""Guards against what rclpy raises for out of spin, which would end the node in mid-run."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

TYPES = frozenset(item.value for item in Parameter.Type)
CLOCK = '/clock'
BEFORE_TIME = '/clock is below 0, it is left out; mend what publishes it'
REPEAT_S = 30.0


def guard(node: Node) -> None:
    """Let ``node`` refuse parameters of no type, and a /clock below zero, and live on."""
    source = node._time_source
    if getattr(source.clock_callback, 'guards', False):
        return
    for service in node.services:
        if service.srv_type in (SetParameters, SetParametersAtomically):
            service.callback = _typed(service.callback)
    source.clock_callback = _positive(node, source.clock_callback)  # type: ignore[assignment, method-assign]
    for item in node.subscriptions:  # where time is simulated from the start
        if item.topic_name == CLOCK:
            item.callback = source.clock_callback


def _typed(plain: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return the callback of a service that changes parameters, which refuses unknown types."""

    def change(request: Any, response: Any) -> Any:
        unknown = [item for item in request.parameters if item.value.type not in TYPES]
        if not unknown:
            return plain(request, response)
        name, number = unknown[0].name, unknown[0].value.type
        reason = f'{name!r:.40} must have a type from 0 to {max(TYPES)}, got {number}'
        refusal = SetParametersResult(successful=False, reason=reason)
        if hasattr(response, 'results'):
            response.results = [refusal] * len(request.parameters)
        else:
            response.result = refusal
        return response

    return change


def _positive(node: Node, plain: Callable[[Clock], None]) -> Callable[[Clock], None]:
    """Return the callback of /clock that leaves times out which rclpy has none for."""

    def tell(message: Clock) -> None:
        if message.clock.sec < 0:
            node.get_logger().warning(BEFORE_TIME, throttle_duration_sec=REPEAT_S)
            return
        plain(message)

    tell.guards = True  # type: ignore[attr-defined]
    return tell
