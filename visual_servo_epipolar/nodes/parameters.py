"""Settings as ROS parameters: declared with text and range, validated as a whole."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
import sys
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from visual_servo_epipolar.core.settings import hint, parameters_of, range_of, Settings
from visual_servo_epipolar.nodes.managed import ParameterNode
from visual_servo_epipolar.nodes.startup import executables, table

SettingsT = TypeVar('SettingsT', bound=Settings)


def declare(node: ParameterNode, kind: type[SettingsT]) -> SettingsT:
    """
    Declare the parameters of ``kind`` and return the settings that YAML and command line ask for.

    An internal setting is declared where it is given: by a program, or as its default, as files of
    earlier versions have it; a setting that is gone may be given the value that holds. In a file
    that nodes share it may be a parameter of another node.

    Raises ValueError for a value that cannot be used, a name of an earlier version, or an internal
    setting of another value; rclpy raises for a wrong type or range.
    """
    given = node.given
    off = {name for name in given.keys() & kind.GONE if _value(given[name]) == kind.GONE[name]}
    renamed = kind.RENAMED.keys() - off
    old = [f'{name} -> {kind.RENAMED[name]}' for name in given if name in renamed]
    gone = given.keys() & kind.GONE.keys() - kind.RENAMED.keys() - off
    old += [f'{name}: gone, {kind.GONE[name]!r} holds' for name in sorted(gone)]
    if old:
        lines = '\n  '.join(['rename or delete them in your file:', *old])
        raise ValueError(f'{node.get_name()} is given names of earlier versions; {lines}')
    known = {item.name for item in parameters_of(kind)}
    skipped = _without_effect(node, kind, known)
    values: dict[str, Any] = {}
    for item in fields(kind):
        if item.name in skipped or (item.name not in known and item.name not in given):
            continue
        default = list(item.default) if isinstance(item.default, tuple) else item.default
        value = node.declare_parameter(item.name, default, _descriptor(item)).value
        if isinstance(item.default, tuple):
            value = tuple(value or ())  # an empty list in YAML leaves the parameter unset
        values[item.name] = value
    return kind(**values)


def _without_effect(node: ParameterNode, kind: type[Settings], known: set[str]) -> set[str]:
    """
    Return internal settings that a file gives another value for other nodes, which have them.

    Raises ValueError for those that no node has.
    """
    asked = {
        item.name: value
        for item in fields(kind)
        if item.name in node.given.keys() - node.by_program - known
        and (value := _value(node.given[item.name])) != item.default
    }
    shared = {name for name in asked if name in table.parameter_names(table.owner_of(name))}
    gone = {name: value for name, value in asked.items() if name not in shared}
    if gone:
        kind(**gone)  # ValueError for a value that says more about itself
        raise ValueError(
            f'{node.get_name()} has no parameter {", ".join(gone)} any more: the default serves '
            'every robot, got another value; take it out of your file (scenario files and '
            'visual_servo replay --set keep it)'
        )
    if shared:
        names = ', '.join(sorted(shared))
        node.get_logger().info(f'{names}: parameters of other nodes, the defaults hold here')
    return shared


def watch(node: Node, attribute: str, then: Callable[[], None] = lambda: None) -> None:
    """
    Let the settings in an ``attribute`` of ``node`` change while it runs, and call ``then``.

    They are validated first, and swapped in as a whole after.
    """

    def changed(parameters: Sequence[Parameter]) -> Settings:
        settings: Settings = getattr(node, attribute)
        names = {item.name for item in fields(settings)}
        return replace(settings, **{p.name: _value(p) for p in parameters if p.name in names})

    def validate(parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            changed(parameters)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(validate)

    def take(parameters: Sequence[Parameter]) -> None:
        before, after = getattr(node, attribute), changed(parameters)
        for item in fields(before):
            old, new = getattr(before, item.name), getattr(after, item.name)
            if old != new:
                node.get_logger().info(f'{item.name}: {old} -> {new}')
        if after != before:
            setattr(node, attribute, after)
            then()

    node.add_post_set_parameters_callback(take)


def override(name: str, value: Any) -> Parameter:
    """Return a parameter of ``value``; an empty list stays unset, for ROS cannot tell its type."""
    return Parameter(name, value=(list(value) or None) if isinstance(value, tuple) else value)


def finish(node: ParameterNode, options: Mapping[str, Any]) -> None:
    """
    End the declarations: raise ValueError for a parameter that is given but not declared.

    ROS ignores it silently, and a misspelt gain then drives the robot with its default. A file may
    hold names of other nodes of this package, which read it as well. ``options`` are those that
    the node was made with. Warns of files that set nothing of the node.
    """
    name, words = node.get_name(), _ros_arguments(options)
    direct = executables.parameter_names(words, name) | node.by_program
    kinds = table.settings_of(*table.NODES.keys() & set(map(table.name_of, type(node).__mro__)))
    gone = {item for kind in kinds for item in kind.GONE}
    own = {item for item in node.given if node.has_parameter(item) or item in gone}
    for item in sorted(node.given.keys() - own):
        owner = table.owner_of(item)
        if item.startswith('qos_') or (owner and item not in direct):
            continue
        other = f'but {owner} has; give it there, or in a file that both read'
        declared = sorted(node.list_parameters([], 0).names)
        more = {each for node_name in table.NODES for each in table.parameter_names(node_name)}
        advice = other if owner else hint([item], [*declared, *sorted(more - {*declared})])
        raise ValueError(f'{name} has no parameter {item}; {advice}')
    files = list(executables.values(words, '--params-file'))
    if files and not own - node.by_program:
        reason = 'they are for other nodes; key them /**: to reach every node that is given them'
        full_name = node.get_fully_qualified_name()
        node.get_logger().warning(f'{", ".join(files)} sets no parameter of {full_name}: {reason}')


def _ros_arguments(options: Mapping[str, Any]) -> list[str]:
    """Return the ROS arguments that a node made with ``options`` follows."""
    heard = list(options.get('cli_args') or ())
    if options.get('use_global_arguments', True):
        heard = [*sys.argv[1:], '--', *heard]
    return executables.split(heard)[0]


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
