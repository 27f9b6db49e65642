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


class GuardedNode(Node):
    """
    Node that refuses in words what rclpy would raise of out of spin.

    That is a parameter of no type, or of a wrong one, and a /clock below zero. ``given`` are the
    parameters of files and command line, by name, declared or not, ``by_program`` the names of
    those that the program gives that makes the node.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.given: dict[str, Parameter] = {}
        self.by_program = {item.name for item in options.get('parameter_overrides') or ()}
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)

    def declare_parameters(
        self, namespace: str, parameters: list[Any], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare parameters; of those that rclpy declares as given, by no kind, take note."""
        if not ignore_override:
            return super().declare_parameters(namespace, parameters)
        self.given = {name: Parameter(name, value=value) for name, value, *_ in parameters}
        return []

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **more: Any) -> Any:
        """Create a service; those of rclpy that change parameters refuse unknown types."""
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = _refusing_unknown_types(callback)
        return super().create_service(srv_type, srv_name, callback, **more)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, qos_profile: Any, **more: Any
    ) -> Any:
        """Create a subscription; that of rclpy to /clock leaves times below zero out."""
        if topic == CLOCK and not more.get('raw'):
            callback = _refusing_negative_times(self, callback)
        return super().create_subscription(msg_type, topic, callback, qos_profile, **more)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none; a reason says which type is expected, rclpy names none."""
        foreign = [item.name for item in parameter_list if not self.has_parameter(item.name)]
        if foreign:
            known = sorted(self.list_parameters([], 0).names)
            reason = f'{self.get_name()} has no parameter {foreign[0]}; {hint(foreign[:1], known)}'
            return SetParametersResult(successful=False, reason=reason)
        result = super().set_parameters_atomically(parameter_list)
        if not result.successful:
            kinds = [self.describe_parameter(item.name).type for item in parameter_list]
            reasons = filter(None, map(wrong_type, parameter_list, map(Parameter.Type, kinds)))
            result.reason = next(reasons, result.reason)
        return result


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
