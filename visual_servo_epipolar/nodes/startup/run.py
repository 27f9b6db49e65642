"""Main loop of every node: init, spin, a clean exit with a zero twist."""

import gc
import signal
import sys
import time
from typing import Any

import cv2
import numpy.ma  # noqa: F401  np.unique and np.median load it: 60 ms in mid-drive
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.nodes.startup import command_line, complaints, process, table
from visual_servo_epipolar.nodes.startup.executor import new_executor, spin_once

FAREWELL_S = 0.5  # after `shutdown`, until the client that asked for it has the answer


def spin(kind: type[Any]) -> int:
    """
    Run a node of this ``kind`` until a signal or its life cycle ends it; return the exit code.

    rclpy's own signal handlers end the context before Python runs again, so that no last twist
    could be published: ours note the signal only. Without one SIGHUP, of a terminal that is
    closed, would leave the robot moving, and SIGTSTP, of Ctrl-Z: after that the node goes on, but
    its run has ended. ``stop`` and ``suspend`` are called of nodes that have them.
    """
    name = table.name_of(kind)
    code = command_line.answer(name, sys.argv[1:])
    if code is not None:
        return code
    process.tune_transport(sends_images=getattr(kind, 'sends_images', False))
    if getattr(kind, 'one_core', False):
        cv2.setNumThreads(1)
    # Lists: a second signal within the lock of an event would wait for it for ever.
    ending: list[signal.Signals] = []
    suspending: list[bool] = []
    process.on_ending(ending.append)
    process.on_suspending(lambda: suspending.append(True))
    node: Node | None = None
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = kind(cli_args=command_line.overrides(sys.argv[1:]))
        complaints.watch(node)
        gc.collect()
        gc.freeze()  # what was imported: a full collection took 40 ms, over a frame
        _run(node, ending, suspending)
    except (ParameterException, VisualServoError, ValueError, RuntimeError, OSError) as error:
        if node is not None:
            raise
        print(f'{name}: {_reason(error, name)}', file=sys.stderr)
        return command_line.USAGE_ERROR
    finally:
        if node is not None:
            getattr(node, 'stop', lambda: None)()
            node.destroy_node()
        rclpy.try_shutdown()
        gc.unfreeze()
        process.ignore_ending()
    return 0


def _run(node: Node, ending: list[signal.Signals], suspending: list[bool]) -> None:
    """Call back for ``node`` until a signal, which the lists get, or its life cycle ends it."""
    executor = new_executor(with_info=getattr(node, 'with_info', False))
    executor.add_node(node)
    while not ending and getattr(node, 'state', '') != 'finalized':
        spin_once(executor, 0.1)
        if suspending:
            suspending.clear()
            getattr(node, 'suspend', lambda: None)()
            process.suspend()
    if not ending:
        time.sleep(FAREWELL_S)


def _reason(error: Exception, name: str) -> str:
    """Return what was wrong in one line."""
    text = ' '.join(str(error).split()) or type(error).__name__
    if type(error).__name__ == 'UnknownROSArgsError':  # its text is the list of them alone
        return f'no ROS arguments: {text}; see {name} --help'
    return text
