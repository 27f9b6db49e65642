"""Executables of the nodes: their command line; they import ROS only when they run."""

from collections.abc import Iterator, Sequence
from functools import partial
from importlib import import_module
import sys

from visual_servo_epipolar.files import PACKAGE
from visual_servo_epipolar.nodes.startup.missing import remedy
from visual_servo_epipolar.nodes.startup.table import NODES
from visual_servo_epipolar.processes import one_thread, printing

USAGE_ERROR = 2
ROS_ARGUMENTS = '--ros-args -p NAME:=VALUE --params-file FILE'


def run(node: str) -> None:
    """Run a node until it ends, and exit."""
    code = answer(node, sys.argv[1:])
    if code is not None:
        sys.exit(code)
    one_thread()
    try:
        module = import_module(f'{PACKAGE}.nodes.{node}')
        spin = import_module(f'{PACKAGE}.nodes.startup.run').spin
    except ImportError as error:
        print(f'{node}: {" ".join(remedy(error).split())}', file=sys.stderr)
        sys.exit(USAGE_ERROR)
    sys.exit(spin(getattr(module, ''.join(map(str.capitalize, node.split('_'))))))


def answer(node: str, arguments: Sequence[str]) -> int | None:
    """Return the exit code if nothing is left to run, the reason printed; or None."""
    ros, rest = split(arguments)
    if {'-h', '--help'}.intersection((*ros, *rest)):
        return printing(node, partial(_show, usage(node)))
    if rest:
        print(
            f'{node}: takes ROS arguments alone, got {" ".join(rest)}; write {node} '
            f'{ROS_ARGUMENTS}, or see {node} --help',
            file=sys.stderr,
        )
        return USAGE_ERROR
    return None


def _show(text: str) -> int:
    print(text)
    return 0


def usage(node: str) -> str:
    """Return what a node does, and how it takes parameters."""
    return f"""usage: {node} [{ROS_ARGUMENTS} -r OLD:=NEW]

{NODES[node].does}

-p name:=value sets a parameter, --params-file FILE those of a YAML file; a double has a point
(1.0). -r image_raw:=/cam/image_raw connects to another topic, -r __ns:=/robot1 sets the
namespace. ros2 node info /{node} lists topics and services, ros2 param describe /{node}
NAME explains a parameter, docs/parameters.md explains all."""


def split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return ROS arguments, which stand between --ros-args and --, and the rest."""
    ros, rest, within = list[str](), list[str](), False
    for word in arguments:
        if word == '--ros-args':
            within = True
        elif within and word == '--':
            within = False
        else:
            (ros if within else rest).append(word)
    return ros, rest


def parameter_names(ros_arguments: Sequence[str], name: str) -> set[str]:
    """Return the parameters that ``-p`` gives to the node called ``name``, or to any node."""
    names = set()
    for rule in values(ros_arguments, '-p', '--param'):
        node, _, parameter = rule.partition(':=')[0].rpartition(':')
        if not node or node.rpartition('/')[2] in (name, '*', '**'):
            names.add(parameter)
    return names


def overrides(arguments: Sequence[str]) -> list[str]:
    """
    Return arguments of a node by which the ``-p`` of a command line hold, whatever files say.

    rcl alone lets the section of a file win over a ``-p``, which it reads as the section /**, if
    /** was in an earlier file, or the ``-p`` stands before the file.
    """
    rules = values(split(arguments)[0], '-p', '--param')
    return ['--ros-args', *(word for rule in rules for word in ('-p', rule))]


def values(ros_arguments: Sequence[str], *options: str) -> Iterator[str]:
    """Yield the values of ``options``, in their order."""
    for option, value in zip(ros_arguments, ros_arguments[1:], strict=False):
        if option in options:
            yield value


servo_node = partial(run, 'servo_node')
tracker_node = partial(run, 'tracker_node')
dock_node = partial(run, 'dock_node')
unicycle_node = partial(run, 'unicycle_node')
camera_node = partial(run, 'camera_node')
recorder_node = partial(run, 'recorder_node')
route_node = partial(run, 'route_node')
