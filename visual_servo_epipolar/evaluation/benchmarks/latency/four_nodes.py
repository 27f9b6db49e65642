"""All four nodes as processes: base and camera are simulated there, this process listens."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
import time
from typing import Any

from sensor_msgs.msg import CameraInfo

from visual_servo_epipolar.evaluation.benchmarks.wire.driven_run import START
from visual_servo_epipolar.evaluation.benchmarks.wire.loop import (
    Drive,
    TRACKER_AND_SERVO,
    TwistListener,
)
from visual_servo_epipolar.evaluation.benchmarks.wire.processes import started
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

BASE_RATE = 100.0  # of ground truth [Hz]; more than images a second
GEOMETRY = ('width', 'height', 'focal_length', 'principal_u', 'principal_v', 'seed', 'frame_rate')


class FourNodes(TwistListener):
    """
    Base, camera, tracker and servo as processes.

    The camera publishes camera_info just before its image: an image is on the wire from when its
    camera_info is heard.
    """

    as_driven: int | None = None  # there is no other run of theirs

    def __init__(self, stack: ExitStack, settings: CameraSettings, folder: Path) -> None:
        super().__init__(stack, 'bench_listener')
        self.node.create_subscription(CameraInfo, 'camera_info', self._on_info, qos.STREAM)
        base = ('-p', 'enable_stamped_cmd_vel:=true', '-p', f'start:={list(START)}')
        nodes = {
            'unicycle_node': (*base, '-p', f'rate:={BASE_RATE}'),
            'camera_node': tuple(_parameters(settings)),
            **TRACKER_AND_SERVO,
        }
        self.processes = started(stack, nodes, folder)

    def wait_for_answers(self) -> None:
        """Wait until the servo answers to images."""
        self.wait(lambda: bool(self.drive.latencies), 'the servo has answered to no image')

    def begin(self) -> None:
        """Begin a run from the start."""
        for node in ('unicycle_node', 'servo_node'):
            self.call(f'{node}/reset')

    def turn(self, seconds: float) -> Drive:
        """Drive for ``seconds`` [s], and return the answers."""
        self.drive = drive = Drive()
        self.spin_for(seconds)
        self.drive = Drive()  # an answer to the last image may be on its way
        drive.sent = dict(list(drive.sent.items())[:-1])
        return drive

    def _on_info(self, message: CameraInfo) -> None:
        self.drive.sent[read.stamp_ns(message.header)] = time.monotonic()


def _parameters(settings: CameraSettings) -> Iterator[str]:
    values: dict[str, Any] = asdict(settings)
    for name in GEOMETRY:
        yield from ('-p', f'{name}:={values[name]}')
