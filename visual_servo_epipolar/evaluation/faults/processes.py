"""Faults of real processes: one of four is harmed while the robot drives."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
import math
from pathlib import Path
import re
import signal
import tempfile
import time
from typing import Any
import zlib

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.fault import BASE, MUTE, SERVO
from visual_servo_epipolar.evaluation.faults.judge import (
    judge_run,
    Limits,
    moving,
    Record,
    SafetyBounds,
    ServoCommand,
    TrueMotion,
)
from visual_servo_epipolar.evaluation.live.processes import (
    arguments,
    camera_arguments,
    Listener,
    Process,
    start_nodes,
)
from visual_servo_epipolar.evaluation.live.world import FRAME_RATE, NODES, small_camera
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup import process
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings
from visual_servo_epipolar.simulation.bases.pioneer import PioneerSettings

DEEP = QoSProfile(depth=500)
SPEAKS = re.compile(r'\[(?:WARN|ERROR|FATAL)\].*?\]: (.*)')
SETTINGS = ServoSettings()
# No node is left to report why the robot stands; of any other node the servo does.
ALONE = (SERVO, BASE)
# Ramps are judged in simulated time alone: here messages come when the machine has time.
LIMITS = Limits(SETTINGS.max_linear, SETTINGS.max_angular, math.inf, math.inf)


class RunListener(Listener):
    """Hears ground truth, tracks, commands and phase; times are of the wall clock [s]."""

    def __init__(self, stack: ExitStack) -> None:
        super().__init__(stack, 'faults_listener')
        self.record, self.struck_s, self.struck_in = Record(), math.nan, ''
        self._logs: dict[Path, int] = {}
        self._begin_s, self._deaf = time.time(), ''
        self._listen()

    @property
    def hears_all(self) -> bool:
        """Whether all publishers that it subscribes to have been found."""
        return all(item.get_publisher_count() for item in self._subscriptions)

    @property
    def moving(self) -> bool:
        """Whether the robot moves."""
        return bool(self.record.truths) and moving(self.record.truths[-1].twist)

    @property
    def time_s(self) -> float:
        """Time since the beginning."""
        return time.time() - self._begin_s

    def strike(self, node: str, logs: Mapping[str, Path]) -> None:
        """Note that ``node`` is harmed now; what ``logs`` say by then explains nothing."""
        self._logs = {path: path.stat().st_size for path in logs.values()}
        self.struck_s, self.struck_in, self._deaf = self.time_s, self.record.phase, node

    def note_resumption(self) -> None:
        """Note that it goes on."""
        if self._deaf == BASE:
            self.record.interventions.woken_s = time.time()
        self._deaf = ''

    def watch_until_rest(self, rest_s: float, longest_s: float) -> None:
        """Hear what comes until the robot has stood for ``rest_s``, or for ``longest_s``."""
        begin_s = moved_s = time.monotonic()
        while time.monotonic() < min(moved_s + rest_s, begin_s + longest_s):
            before = len(self.record.truths)
            self.spin_for(0.1)
            if self.moving and len(self.record.truths) > before:
                moved_s = time.monotonic()

    def finish(self) -> Record:
        """Return the record, with what the nodes wrote to standard error since."""
        record = self.record
        if self._deaf == BASE:  # a base whose process is gone or hangs stands
            record.truths.append(record.truths[-1]._replace(time_s=time.time(), twist=STANDSTILL))
        if self._deaf in ALONE:
            record.why.append(f'{self._deaf} is gone, or hangs')
        for path, begin in self._logs.items():
            text = path.read_bytes()[begin:].decode(errors='replace')
            record.why += SPEAKS.findall(text)
            if 'Traceback' in text:
                record.crashes.append(f'{path.stem}: {text[text.index("Traceback") :]}')
        if record.phase in MUTE and record.reason:
            record.why.append(record.reason)
        return record

    def _listen(self) -> None:
        heard = (
            (Odometry, 'ground_truth', self._on_truth, DEEP),
            (PointCloud2, 'tracks', self._on_tracks, DEEP),
            (TwistMessage, 'cmd_vel', self._on_command, DEEP),
            (String, 'phase', self._on_phase, qos.LATCHED),
            (DiagnosticArray, '/diagnostics', self._on_diagnostics, DEEP),
        )
        self._subscriptions = [self.node.create_subscription(*each) for each in heard]

    def _on_truth(self, message: Any) -> None:
        time_s = read.stamp_ns(message.header) / NANOSECONDS
        twist = read.twist(message.twist)
        self.record.truths.append(TrueMotion(time_s, read.pose(message), twist))

    def _on_tracks(self, message: Any) -> None:
        if self._deaf == SERVO:
            return
        taken_s = read.stamp_ns(message.header) / NANOSECONDS
        enough, carried_s = SETTINGS.min_features, SETTINGS.few_features_timeout
        self.record.sight.note(message.width, time.time(), taken_s, enough, carried_s)

    def _on_command(self, message: Any) -> None:
        self.record.orders.append(ServoCommand(time.time(), read.twist(message), LIMITS))

    def _on_phase(self, message: Any) -> None:
        self.record.phase = str(message.data)

    def _on_diagnostics(self, message: Any) -> None:
        said = read.diagnosis(message)
        if 'reason' in said:
            self.record.reason = said['reason']


@dataclass(frozen=True, slots=True)
class ProcessFault:
    """What is done to the process of ``node``: a signal; if it ``resumes``, perhaps for a time."""

    what: str
    node: str
    signal: signal.Signals
    resumes: bool = False

    @property
    def mute(self) -> bool:
        """Whether the servo cannot stop the base any more."""
        return self.node == SERVO and self.signal in (signal.SIGKILL, signal.SIGSTOP)


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
        f'{words}, process of {node}', node, number, number in (signal.SIGSTOP, signal.SIGTSTP)
    )
    for kind, (number, words) in KINDS.items()
    for node in NODES
}


START_S, REST_S, LONGEST_S = 90.0, 3.0, 120.0
LATE_S = 0.5  # by which a busy machine may deliver what is sent, or run what is due
PIONEER = PioneerSettings()


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
    The base stops by itself only where nothing else can stop it.
    """
    timeout_s = PIONEER.command_timeout if fault.mute else 0.0
    heard = {
        'servo_node': arguments(autostart='true'),
        'tracker_node': (),
        'unicycle_node': arguments(start=start, command_timeout=timeout_s),
    }
    if fault.signal in (*process.ENDING, signal.SIGTSTP):
        # What this process ignores, as under nohup, its children would ignore as well.
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
        base_acceleration=math.inf,
        base_deceleration=PIONEER.deceleration,
        base_angular_acceleration=PIONEER.angular_acceleration,
    )
