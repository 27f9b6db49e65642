"""Listener: hears what real processes publish, and writes the record of their run."""

from collections.abc import Mapping
from contextlib import ExitStack
import math
from pathlib import Path
import re
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.judging.record import (
    Limits,
    moving,
    Record,
    ServoCommand,
    TrueMotion,
)
from visual_servo_epipolar.evaluation.faults.judging.witness import MUTE
from visual_servo_epipolar.evaluation.live.processes import Listener
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos

DEEP = QoSProfile(depth=500)
SPEAKS = re.compile(r'\[(?:WARN|ERROR|FATAL)\].*?\]: (.*)')
SETTINGS = ServoSettings()
# Nobody is left to say why the robot stands; of any other node the servo does.
ALONE = ('servo_node', 'unicycle_node')
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
        """Whether everybody whom it hears has been found."""
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
        if self._deaf == 'unicycle_node':
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
        if self._deaf == 'unicycle_node':  # a base whose process is gone or hangs stands
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
        if self._deaf == 'servo_node':
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
