"""A node by its name: its class, its row in docs/ros.md, its process on this machine alone."""

from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

import command_line

ROOT = Path(__file__).parents[2]


def node_class(name: str) -> Any:
    """Return the class of a node: ServoNode of servo_node."""
    kind = ''.join(map(str.capitalize, name.split('_')))
    return getattr(import_module(f'visual_servo_epipolar.nodes.{name}'), kind)


def row_of(name: str) -> list[set[str]]:
    """Return what docs/ros.md names of a node: topics in, topics out, services; none of others."""
    rows = (ROOT / 'docs/ros.md').read_text(encoding='utf-8').splitlines()
    row = next((line for line in rows if line.startswith(f'| `{name}` |')), '|||||')
    return [set(re.findall('`([^`]+)`', cell)) for cell in row.split('|')[2:5]]


def environment(domain: int) -> dict[str, str]:
    """Return the environment of a process that talks in ``domain``, on this machine alone."""
    alone = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    return command_line.environment(**alone)


def arguments(name: str, *more: str) -> list[str]:
    """Return the command line of a node, with ROS arguments."""
    return [sys.executable, '-m', f'visual_servo_epipolar.nodes.{name}', '--ros-args', *more]


def started(stack: ExitStack, env: dict[str, str], command: list[str], log: Path) -> Any:
    """Start a process whose errors go to ``log``; it is killed at the end of the stack."""
    process = stack.enter_context(
        subprocess.Popen(
            command,
            env=env,
            stderr=stack.enter_context(log.open('w')),
            cwd=log.parent,
            start_new_session=True,  # it must not inherit an ignored SIGINT
        )
    )
    stack.callback(process.kill)
    return process
