"""Process of a node: its executor, transport, signals, and a clean exit with a zero twist."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
import ctypes
import gc
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

import cv2
import numpy.ma  # noqa: F401  np.unique and np.median load it: 60 ms in mid-drive
import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.nodes import parameters
from visual_servo_epipolar.nodes.startup import executables, table

FAREWELL_S = 0.5  # after `shutdown`, until the client that asked for it has the answer
KEEP_BYTES = 2**23  # an image of 8 MB; a match of whole images takes 300 MB for a moment
DISCOVERY = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS')
# Ctrl-C, kill, a terminal that is closed, Ctrl-backslash.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def spin(kind: type[Any]) -> int:
    """
    Run a node of this ``kind`` until a signal or its life cycle ends it; return the exit code.

    rclpy's own signal handlers end the context before Python runs again, so that no last twist
    could be published: ours note the signal only. Without one SIGHUP, of a terminal that is
    closed, would leave the robot moving, and SIGTSTP, of Ctrl-Z: after that the node goes on, but
    its run has ended. ``stop`` and ``suspend`` are called of nodes that have them.
    """
    name = table.name_of(kind)
    code = executables.answer(name, sys.argv[1:])
    if code is not None:
        return code
    tune_transport(sends_images=getattr(kind, 'sends_images', False))
    if getattr(kind, 'one_core', False):
        cv2.setNumThreads(1)
    heard: list[int] = []  # no event: a second signal within its lock would wait for ever
    of_terminal = signal.SIGHUP, signal.SIGTSTP  # which a node started by nohup is to outlive
    for number in {*ENDING, *of_terminal}:
        if number not in of_terminal or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda received, _: heard.append(received))
    node: Node | None = None
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = kind(cli_args=executables.overrides(sys.argv[1:]))
        gc.collect()
        gc.freeze()  # what was imported: a full collection took 40 ms, over a frame
        _run(node, heard)
    except (ParameterException, VisualServoError, ValueError, RuntimeError, OSError) as error:
        if node is not None:
            raise
        print(f'{name}: {_reason(error, name)}', file=sys.stderr)
        return executables.USAGE_ERROR
    finally:
        if node is not None:
            getattr(node, 'stop', lambda: None)()
            node.destroy_node()
        rclpy.try_shutdown()
        gc.unfreeze()
        for number in ENDING:  # a second Ctrl-C finds nothing left to end
            signal.signal(number, signal.SIG_IGN)
    return 0


def _run(node: Node, heard: list[int]) -> None:
    """Call back for ``node`` until a signal, which is ``heard``, or its life cycle ends it."""
    executor = new_executor(with_info=getattr(node, 'with_info', False))
    executor.add_node(node)
    while not heard and getattr(node, 'state', '') != 'finalized':
        spin_once(executor, 0.1)
        if signal.SIGTSTP in heard:
            while signal.SIGTSTP in heard:
                heard.remove(signal.SIGTSTP)
            getattr(node, 'suspend', lambda: None)()
            os.kill(os.getpid(), signal.SIGSTOP)  # until SIGCONT
    if not heard:
        time.sleep(FAREWELL_S)


def _reason(error: Exception, name: str) -> str:
    """Return what was wrong in one line."""
    text = ' '.join(str(error).split()) or type(error).__name__
    if type(error).__name__ == 'UnknownROSArgsError':  # its text is the list of them alone
        return f'no ROS arguments: {text}; see {name} --help'
    return text


def new_executor(context: Context | None = None, *, with_info: bool = False) -> Executor:
    """
    Return an executor, to be spun by ``spin_once`` with a timeout in a loop.

    That of events spends a tenth of the time of the other on a message. Its ``spin`` never
    returns, and a subscription that asks for the info of a message, ``with_info``, breaks it.
    """
    try:
        from rclpy.experimental import EventsExecutor  # since rclpy 7.1.4
    except ImportError:
        with_info = True
    return (
        SingleThreadedExecutor(context=context) if with_info else EventsExecutor(context=context)
    )


def spin_once(executor: Executor, timeout_sec: float) -> None:
    """Call back for what is ready within ``timeout_sec`` [s], but for events of what is gone."""
    with suppress(InvalidHandle):  # a callback's own is logged by the executor
        executor.spin_once(timeout_sec=timeout_sec)


def hand_out(subscription: Subscription) -> bool:
    """Call back for the next message that waits, a raw one with its info; False of none."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:  # another callback has just destroyed it
        return False
    if taken is None:
        return False
    subscription.callback(*taken if subscription.raw else taken[:1])
    return True


@contextmanager
def isolated_context(reach: str = 'OFF', *, domain_id: int | None = None) -> Iterator[Context]:
    """
    Yield a context seen within ``reach`` only: its nodes must not drive a robot in the room.

    New nodes see this process (OFF), this machine (LOCALHOST), or all (SUBNET).
    """
    tune_transport()
    # The older variables would overrule the range.
    before = {name: os.environ.pop(name, None) for name in DISCOVERY}
    os.environ[DISCOVERY[0]] = reach
    context = Context()
    try:
        rclpy.init(args=[], context=context, domain_id=domain_id)
        yield context
    finally:
        context.try_shutdown()
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def new_node(kind: Any, context: Context, values: Mapping[str, Any]) -> Any:
    """Return a node of ``kind`` with these parameters."""
    return kind(
        context=context,
        parameter_overrides=[parameters.override(*each) for each in values.items()],
        use_global_arguments=False,
    )


def tune_transport(*, sends_images: bool = True) -> None:
    """
    Tune the transport for images: shared memory for whole frames, and buffers that are kept.

    The default segment is smaller than one image that is sent, and glibc returns megabyte buffers
    to the kernel after each message; those larger than an image, of a matching, may go back. Both
    are settings of this process alone; a profile of the user's own
    (FASTRTPS_DEFAULT_PROFILES_FILE) is left as it is.
    """
    profile = Path(__file__).with_name('fastdds_profile.xml')
    if sends_images and profile.is_file():
        os.environ.setdefault('FASTRTPS_DEFAULT_PROFILES_FILE', str(profile))
    if sys.platform == 'linux':
        libc = ctypes.CDLL(None)
        if hasattr(libc, 'mallopt'):
            for option in (-3, -1):  # M_MMAP_THRESHOLD, M_TRIM_THRESHOLD
                libc.mallopt(option, KEEP_BYTES)
