"""Types of parameters: why a value is refused, in words, and how to write it."""

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from visual_servo_epipolar.core.settings import hint

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


def explain_refusals(node: Node) -> None:
    """Let the reason for a refused change say which type is expected; rclpy names none."""
    plain = node.set_parameters_atomically
    if getattr(plain, 'explains', False):
        return

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

    explained.explains = True  # type: ignore[attr-defined]
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
