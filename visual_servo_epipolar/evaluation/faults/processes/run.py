"""Faults of real processes: one of four is harmed while the robot drives."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
import signal
import tempfile
from typing import Any
import zlib

import numpy as np

from visual_servo_epipolar.evaluation.faults.judging.judge import judge_run
from visual_servo_epipolar.evaluation.faults.judging.record import SafetyBounds
from visual_servo_epipolar.evaluation.faults.processes.listener import RunListener, SETTINGS
from visual_servo_epipolar.evaluation.live.processes import (
    arguments,
    camera_arguments,
    Process,
    start_nodes,
)
from visual_servo_epipolar.evaluation.live.world import FRAME_RATE, small_camera
from visual_servo_epipolar.nodes.startup import process
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings
from visual_servo_epipolar.simulation.bases.pioneer import PioneerSettings

SUSPENDING = (signal.SIGSTOP, signal.SIGTSTP)
NODES = ('servo_node', 'tracker_node', 'camera_node', 'unicycle_node')


@dataclass(frozen=True, slots=True)
class ProcessFault:
    """
    What is done to the process of ``node``: a signal.

    ``resumes``: it may be continued later.
    """

    what: str
    node: str
    signal: signal.Signals
    resumes: bool = False

    @property
    def mute(self) -> bool:
        """Whether the servo cannot stop the base any more."""
        return self.node == 'servo_node' and self.signal in (signal.SIGKILL, signal.SIGSTOP)


KINDS: Mapping[str, tuple[signal.Signals, str]] = {
    'kill': (signal.SIGKILL, 'kill -9'),
    'hangup': (signal.SIGHUP, 'SIGHUP, as of a terminal that is closed'),
    'quit': (signal.SIGQUIT, 'SIGQUIT'),
    'interrupt': (signal.SIGINT, 'SIGINT'),
    'terminate': (signal.SIGTERM, 'SIGTERM'),
    'stop': (signal.SIGSTOP, 'SIGSTOP, and SIGCONT later or never'),
    'suspend': (signal.SIGTSTP, 'SIGTSTP, as of Ctrl-Z, and SIGCONT later or never'),
}
PROCESSES: Mapping[str, ProcessFault] = {
    f'process_{kind}_{node.removesuffix("_node")}': ProcessFault(
        f'{words}, process of {node}', node, number, number in SUSPENDING
    )
    for kind, (number, words) in KINDS.items()
    for node in NODES
}


START_S, REST_S, LONGEST_S = 90.0, 3.0, 120.0
LATE_S = 0.5  # by which a busy machine may deliver what is sent, or run who is due
BASE = PioneerSettings()


def run(name: str, fault: ProcessFault, seed: int) -> dict[str, Any]:
    """Start the nodes, harm one while the robot drives, and return what became of it."""
    rng = np.random.default_rng((seed, zlib.crc32(name.encode())))
    start = [float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-3.0, -2.0)), 0.0]
    after_s, hung_s = float(rng.uniform(0.3, 4.0)), float(rng.uniform(0.3, 4.0))
    resumes = fault.resumes and bool(rng.random() < 0.5)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        listener = RunListener(stack)
        harmed = _team(stack, folder, seed, start, fault, listener)[fault.node]
        listener.wait(lambda: listener.moving, 'no robot has moved', START_S)
        listener.spin_for(after_s)
        logs = {node: folder / f'{node}.log' for node in NODES}
        listener.strike(fault.node, logs)
        harmed.send_signal(fault.signal)
        if resumes:
            listener.spin_for(hung_s)
            listener.note_resumption()
            harmed.send_signal(signal.SIGCONT)
        listener.watch_until_rest(REST_S, LONGEST_S)
        record = listener.finish()
    return judge_run(record, _bounds()).document(
        record,
        fault=name,
        seed=seed,
        start=start,
        struck_s=listener.struck_s,
        struck_in=listener.struck_in,
        notes=[f'continued after {hung_s:.1f} s'] if resumes else [],
        duration_s=listener.time_s,
    )


def _team(
    stack: ExitStack,
    folder: Path,
    seed: int,
    start: list[float],
    fault: ProcessFault,
    listener: RunListener,
) -> dict[str, Process]:
    """
    Start the four nodes; they end with the stack.

    The camera comes last: a robot that drives before the tracks are heard would be judged blind.
    The base stops by itself only where nobody else can stop it.
    """
    timeout_s = BASE.command_timeout if fault.mute else 0.0
    heard = {
        'servo_node': arguments(autostart='true'),
        'tracker_node': (),
        'unicycle_node': arguments(start=start, command_timeout=timeout_s),
    }
    if fault.signal in (*process.ENDING, signal.SIGTSTP):
        # What this process ignores, as nohup has it, its children would ignore as well.
        stack.callback(signal.signal, fault.signal, signal.signal(fault.signal, signal.SIG_DFL))
    processes = start_nodes(stack, heard, folder, logs=True)
    listener.wait(lambda: listener.hears_all, 'not every node is heard', START_S)
    camera = {'camera_node': camera_arguments(small_camera(seed))}
    return processes | start_nodes(stack, camera, folder, logs=True)


def _bounds() -> SafetyBounds:
    """Return what is allowed; ramps of the base between messages are not judged."""
    latency_s = ServoNodeSettings().max_latency
    period_s = 1.0 / FRAME_RATE
    return SafetyBounds(
        sight_s=SETTINGS.stale_timeout + latency_s + period_s + LATE_S,
        period_s=period_s,
        base_acceleration=float('inf'),
        base_deceleration=BASE.deceleration,
        base_angular_acceleration=BASE.angular_acceleration,
    )
