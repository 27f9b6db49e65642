"""Guards of parameters and /clock: refusals in words, where rclpy would raise out of spin."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from visual_servo_epipolar.core.settings import hint

TYPE_NUMBERS = frozenset(item.value for item in Parameter.Type)
CLOCK = '/clock'
BEFORE_TIME = '/clock is below 0, it is left out; mend what publishes it'
REPEAT_S = 30.0
TYPES = {
    Parameter.Type.BOOL: 'a boolean',
    Parameter.Type.INTEGER: 'an integer',
    Parameter.Type.DOUBLE: 'a double',
    Parameter.Type.STRING: 'a string',
    Parameter.Type.BYTE_ARRAY: 'a list of bytes',
    Parameter.Type.BOOL_ARRAY: 'a list of booleans',
    Parameter.Type.INTEGER_ARRAY: 'a list of integers',
    Parameter.Type.DOUBLE_ARRAY: 'a list of doubles',
    Parameter.Type.STRING_ARRAY: 'a list of strings',
}


def guard(node: Node) -> None:
    """Let ``node`` refuse parameters of no type, and a /clock below zero, and live on."""
    source = node._time_source
    for service in node.services:
        if service.srv_type in (SetParameters, SetParametersAtomically):
            service.callback = _refusing_unknown_types(service.callback)
    source.clock_callback = _refusing_negative_times(node, source.clock_callback)  # type: ignore[assignment, method-assign]
    for item in node.subscriptions:  # where time is simulated from the start
        if item.topic_name == CLOCK:
            item.callback = source.clock_callback


def _refusing_unknown_types(plain: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return the callback of a service that changes parameters, which refuses unknown types."""

    def change(request: Any, response: Any) -> Any:
        unknown = [item for item in request.parameters if item.value.type not in TYPE_NUMBERS]
        if not unknown:
            return plain(request, response)
        name, number = unknown[0].name, unknown[0].value.type
        reason = f'{name!r:.40} must have a type from 0 to {max(TYPE_NUMBERS)}, got {number}'
        refusal = SetParametersResult(successful=False, reason=reason)
        if hasattr(response, 'results'):
            response.results = [refusal] * len(request.parameters)
        else:
            response.result = refusal
        return response

    return change


def _refusing_negative_times(
    node: Node, plain: Callable[[Clock], None]
) -> Callable[[Clock], None]:
    """Return the callback of /clock that leaves times out which rclpy has none for."""

    def tell(message: Clock) -> None:
        if message.clock.sec < 0:
            node.get_logger().warning(BEFORE_TIME, throttle_duration_sec=REPEAT_S)
            return
        plain(message)

    return tell


def explain_refusals(node: Node) -> None:
    """Let the reason for a refused change say which type is expected; rclpy names none."""
    plain = node.set_parameters_atomically

    def explained(changes: list[Parameter]) -> SetParametersResult:
        foreign = [item.name for item in changes if not node.has_parameter(item.name)]
        if foreign:
            known = sorted(node.list_parameters([], 0).names)
            reason = f'{node.get_name()} has no parameter {foreign[0]}; {hint(foreign[:1], known)}'
            return SetParametersResult(successful=False, reason=reason)
        result = plain(changes)
        if not result.successful:
            expected = [Parameter.Type(node.describe_parameter(p.name).type) for p in changes]
            reasons = filter(None, map(wrong_type, changes, expected))
            result.reason = next(reasons, result.reason)
        return result

    node.set_parameters_atomically = explained  # type: ignore[assignment, method-assign]


def wrong_type(given: Parameter, expected: Parameter.Type) -> str:
    """Return why a value has the wrong type, and how to write it; or nothing."""
    kind, value = given.type_, given.value
    if kind in (expected, Parameter.Type.NOT_SET):  # an empty list has no type
        return ''
    advice = ''
    if (kind, expected) == (Parameter.Type.INTEGER, Parameter.Type.DOUBLE):
        advice = f', write {float(value)!r}'
    elif (kind, expected) == (Parameter.Type.INTEGER_ARRAY, Parameter.Type.DOUBLE_ARRAY):
        value = list(value)
        advice = f', write {list(map(float, value))}'
    noun = TYPES[kind].partition(' ')[2]
    return f'{given.name} must be {TYPES[expected]}{advice}, got the {noun} {value}'
