"""Executables of the nodes: they import ROS only when they run, and report it if it is missing."""

from functools import partial
from importlib import import_module
import os
import signal
import sys

from visual_servo_epipolar.nodes.startup.command_line import answer, USAGE_ERROR
from visual_servo_epipolar.nodes.startup.missing import remedy
from visual_servo_epipolar.nodes.startup.process import on_ending
from visual_servo_epipolar.nodes.startup.table import PACKAGE
from visual_servo_epipolar.processes import one_thread

INTERRUPTED = 130


def run(node: str) -> int:
    """Run a node until it ends, and return the exit code."""
    code = answer(node, sys.argv[1:])
    if code is not None:
        return code
    on_ending(lambda number: _leave(node, number))
    one_thread()
    try:
        module = import_module(f'{PACKAGE}.nodes.{node}')
        spin = import_module(f'{PACKAGE}.nodes.startup.run').spin
    except ImportError as error:
        print(f'{node}: {" ".join(remedy(error).split())}', file=sys.stderr)
        return USAGE_ERROR
    return int(spin(getattr(module, ''.join(map(str.capitalize, node.split('_'))))))


def _leave(node: str, number: signal.Signals) -> None:
    """
    End the process before the node has begun: nothing moves, nothing is lost.

    An exception would not end it where an extension module swallows it while it is imported.
    """
    if number is not signal.SIGINT:
        os.write(2, f'{node}: ended by {number.name} before it had begun\n'.encode())
    os._exit(INTERRUPTED if number is signal.SIGINT else 0)


def _main(node: str) -> None:
    sys.exit(run(node))


servo_node = partial(_main, 'servo_node')
tracker_node = partial(_main, 'tracker_node')
dock_node = partial(_main, 'dock_node')
unicycle_node = partial(_main, 'unicycle_node')
camera_node = partial(_main, 'camera_node')
recorder_node = partial(_main, 'recorder_node')
route_node = partial(_main, 'route_node')
