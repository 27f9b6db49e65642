"""A stand-in for launch and launch_ros, which pip lacks: just what our launch files use."""

from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from loaded import loaded

ROOT = Path(__file__).parents[2]


class Configurations(dict[str, str]):
    """Values of the arguments; remembers which were asked for."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.used: set[str] = set()

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        return super().__getitem__(name)


def _stand_in(name: str, *fields: str) -> type:
    return make_dataclass(name, fields, frozen=True)


LaunchConfiguration = _stand_in('LaunchConfiguration', 'name')
FindPackageShare = _stand_in('FindPackageShare', 'package')
PathJoinSubstitution = _stand_in('PathJoinSubstitution', 'parts')
ParameterValue = _stand_in('ParameterValue', 'value', 'value_type')
LaunchDescription = _stand_in('LaunchDescription', 'entities')
OpaqueFunction = _stand_in('OpaqueFunction', 'function')


@dataclass(frozen=True)
class DeclareLaunchArgument:
    name: str
    default_value: str
    description: str
    choices: list[str] | None = None


@dataclass
class Node:
    package: str
    executable: str
    name: str = ''
    namespace: str = ''
    parameters: list[Any] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    output: str = 'log'


MODULES = {
    'launch': [LaunchDescription],
    'launch.actions': [DeclareLaunchArgument, OpaqueFunction],
    'launch.substitutions': [LaunchConfiguration, PathJoinSubstitution],
    'launch_ros': [],
    'launch_ros.actions': [Node],
    'launch_ros.parameter_descriptions': [ParameterValue],
    'launch_ros.substitutions': [FindPackageShare],
}


def modules() -> dict[str, SimpleNamespace]:
    """Return the modules by name, for sys.modules."""
    return {
        name: SimpleNamespace(**{member.__name__: member for member in members})
        for name, members in MODULES.items()
    }


class Launch:
    """What a launch file comes to with some arguments: nodes, with paths and values filled in."""

    def __init__(self, name: str, **arguments: str) -> None:
        self.nodes: list[Node] = []
        self.declared: dict[str, DeclareLaunchArgument] = {}
        self.configurations = Configurations(arguments)
        unknown = set(arguments)
        for entity in loaded(ROOT / 'launch' / name).generate_launch_description().entities:
            self._visit(entity, self.configurations)
        assert unknown <= self.declared.keys()

    def _visit(self, entity: Any, values: Configurations) -> None:
        if isinstance(entity, DeclareLaunchArgument):
            self.declared.setdefault(entity.name, entity)
            value = values.setdefault(entity.name, entity.default_value)
            assert entity.choices is None or value in entity.choices, (entity.name, value)
        elif isinstance(entity, OpaqueFunction):
            context = SimpleNamespace(launch_configurations=values)
            for item in entity.function(context):
                self._visit(item, values)
        else:
            assert isinstance(entity, Node), entity
            entity.parameters = [resolved(item, values) for item in entity.parameters]
            entity.arguments = [resolved(item, values) for item in entity.arguments]
            self.nodes.append(entity)


def resolved(item: Any, values: Configurations) -> Any:
    """Return text, numbers and dicts for substitutions."""
    if isinstance(item, LaunchConfiguration):
        return values[item.name]
    if isinstance(item, FindPackageShare):
        assert item.package == 'visual_servo_epipolar'
        return str(ROOT)
    if isinstance(item, PathJoinSubstitution):
        return '/'.join(resolved(part, values) for part in item.parts)
    if isinstance(item, ParameterValue):
        text = resolved(item.value, values)
        return text == 'true' if item.value_type is bool else item.value_type(text)
    if isinstance(item, dict):
        return {name: resolved(value, values) for name, value in item.items()}
    return item
