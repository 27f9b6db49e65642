"""Executables of the nodes: they import ROS only when they run, and report it if it is missing."""

from functools import partial
from importlib import import_module
import os
import signal
import sys

from visual_servo_epipolar.nodes.startup.command_line import answer, USAGE_ERROR
from visual_servo_epipolar.nodes.startup.missing import NO_ROS, remedy
from visual_servo_epipolar.nodes.startup.process import on_ending
from visual_servo_epipolar.nodes.startup.table import PACKAGE
from visual_servo_epipolar.threads import one_thread

# What nodes import beside ROS 2.
PIP_PACKAGES = ('cv2', 'matplotlib', 'mcap', 'numpy', 'rosbags', 'yaml')
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
        if (error.name or '').startswith(PACKAGE):
            raise  # a mistake of our own
        print(f'{node}: {_missing(error)}', file=sys.stderr)
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


def _missing(error: ImportError) -> str:
    package = (error.name or '').partition('.')[0]
    text = ' '.join(str(error).split())
    if package in ('mcap', 'rosbags'):  # without a rosdep key
        return remedy(error)
    if package in PIP_PACKAGES:
        return f'{package} cannot be imported ({text}); install it by rosdep or pip'
    return NO_ROS.format(text)


def _main(node: str) -> None:
    sys.exit(run(node))


servo_node = partial(_main, 'servo_node')
tracker_node = partial(_main, 'tracker_node')
dock_node = partial(_main, 'dock_node')
unicycle_node = partial(_main, 'unicycle_node')
camera_node = partial(_main, 'camera_node')
recorder_node = partial(_main, 'recorder_node')
route_node = partial(_main, 'route_node')
