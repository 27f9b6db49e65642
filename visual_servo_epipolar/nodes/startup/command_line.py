"""Command line of a node: --help, what is no ROS argument, and the parameters it gives."""

from collections.abc import Iterator, Sequence
import os
import sys
import textwrap

from visual_servo_epipolar.nodes.startup.table import NODES

USAGE_ERROR, UNREAD = 2, 141
ROS_ARGUMENTS = '--ros-args -p NAME:=VALUE --params-file FILE'


def answer(node: str, arguments: Sequence[str]) -> int | None:
    """Return the exit code if nothing is left to run, the reason printed; or None."""
    ros, rest = split(arguments)
    if {'-h', '--help'}.intersection((*ros, *rest)):
        return _print(usage(node))
    if rest:
        print(
            f'{node}: takes ROS arguments alone, got {" ".join(rest)}; write {node} '
            f'{ROS_ARGUMENTS}, or see {node} --help',
            file=sys.stderr,
        )
        return USAGE_ERROR
    return None


def _print(text: str) -> int:
    """Print ``text`` and return the exit code, also where the reader left, as after ``| head``."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        # The interpreter would complain at its end about what it cannot write out.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    return 0


def usage(node: str) -> str:
    """Return what a node does, what it is connected to, and how it takes parameters."""
    row = NODES[node]
    connections = {title: getattr(row, title) for title in ('subscribes', 'publishes', 'services')}
    return '\n'.join(
        [
            f'usage: {node} [{ROS_ARGUMENTS} -r OLD:=NEW]',
            '',
            row.does,
            '',
            *(
                textwrap.fill(f'{title + ":":12}{names}', 99, subsequent_indent=' ' * 12)
                for title, names in connections.items()
                if names
            ),
            '',
            '-p name:=value sets a parameter, --params-file FILE those of a YAML file; a double',
            'has a point (1.0). -r image_raw:=/cam/image_raw connects to another topic,',
            f'-r __ns:=/robot1 sets the namespace. ros2 param describe /{node} NAME explains a',
            'parameter, docs/parameters.md explains all.',
        ]
    )


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
