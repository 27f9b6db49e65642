"""Settings as ROS parameters: declared with text and range, validated as a whole."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
import difflib
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from visual_servo_epipolar.core.settings import range_of, Settings

SettingsT = TypeVar('SettingsT', bound=Settings)


def declare(node: Node, kind: type[SettingsT]) -> SettingsT:
    """
    Declare every field of ``kind`` and return the settings that YAML and command line ask for.

    Raises ValueError for a value that cannot be used or a name of an earlier version; rclpy raises
    for a wrong type or range.
    """
    _refuse_renamed(node, kind)
    values: dict[str, Any] = {}
    for item in fields(kind):
        default = list(item.default) if isinstance(item.default, tuple) else item.default
        value = node.declare_parameter(item.name, default, _descriptor(item)).value
        if isinstance(item.default, tuple):
            value = tuple(value or ())  # an empty list in YAML leaves the parameter unset
        values[item.name] = value
    return kind(**values)


def watch(node: Node, current: Callable[[], SettingsT], use: Callable[[SettingsT], None]) -> None:
    """Let parameters change while the node runs: validated first, swapped in as a whole after."""

    def changed(parameters: Sequence[Parameter]) -> SettingsT:
        settings = current()
        names = {item.name for item in fields(settings)}
        return replace(settings, **{p.name: _value(p) for p in parameters if p.name in names})

    def validate(parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            changed(parameters)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(lambda parameters: use(changed(parameters)))


def override(name: str, value: Any) -> Parameter:
    """Return a parameter of ``value``; an empty list stays unset, for ROS cannot tell its type."""
    return Parameter(name, value=(list(value) or None) if isinstance(value, tuple) else value)


def _refuse_renamed(node: Node, kind: type[Settings]) -> None:
    for name in getattr(node, '_parameter_overrides', {}):
        if name in kind.RENAMED:
            raise ValueError(
                f'{node.get_name()} calls the parameter {name} {kind.RENAMED[name]} now; '
                'rename it in your file'
            )


def refuse_unknown(node: Node) -> None:
    """
    Raise ValueError for a parameter that was given but that the node does not have.

    ROS ignores it silently, and a misspelt gain then drives the robot with its default.
    """
    given = set(getattr(node, '_parameter_overrides', {}))
    unknown = sorted(
        name for name in given if not node.has_parameter(name) and not name.startswith('qos_')
    )
    if unknown:
        declared = sorted(node.list_parameters([], 0).names)
        close = difflib.get_close_matches(unknown[0], declared, n=1)
        hint = f'; did you mean {close[0]}?' if close else f'; it has {", ".join(declared)}'
        raise ValueError(f'{node.get_name()} has no parameter {", ".join(unknown)}{hint}')


def _value(parameter: Parameter) -> Any:
    value = parameter.value
    return tuple(value) if hasattr(value, '__len__') and not isinstance(value, str) else value


def _descriptor(item: Any) -> ParameterDescriptor:
    limits = range_of(item)
    text = limits.text
    if limits.choices:
        text = f'{text}: one of {", ".join(limits.choices)}'
    descriptor = ParameterDescriptor(name=item.name, description=text, read_only=limits.read_only)
    if limits.low is None or limits.high is None:
        return descriptor
    if isinstance(item.default, float):
        low, high = float(limits.low), float(limits.high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif isinstance(item.default, int):
        low, high = int(limits.low), int(limits.high)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return descriptor
