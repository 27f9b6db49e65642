"""Processes of the recording benchmark: tracker, servo and recorder, and their camera here."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, field
import os
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.geometry.cameras.calibrated import CalibratedCamera
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.transport import tune_transport

NODES = {
    'tracker_node': ('-p', 'camera_reliability:=reliable'),
    'servo_node': ('-p', 'camera_reliability:=reliable', '-p', 'autostart:=true'),
    'recorder_node': ('-p', 'autostart:=false', '-p', 'topics:=["*"]'),
}
# Its own among benchmarks that run at a time, and above those that people use.
DOMAIN = 216 + os.getpid() % 16
DISCOVERY = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
FRAME_ID = 'camera_optical_frame'
START_S, WARM_UP_S, SETTLE_S = 60.0, 1.0, 0.5


@dataclass(slots=True)
class Drive:
    """A stretch of time: when images were sent, and the latencies of the servo."""

    sent: dict[int, float] = field(default_factory=dict)  # by stamp [ns], on the steady clock [s]
    latencies: list[float] = field(default_factory=list)  # image sent to epipoles received [s]


class Loop:
    """
    Three nodes in processes of their own; this process is their camera and reads the epipoles.

    Parameters
    ----------
    images : sequence of images
        What the camera shows, over and over.
    folder : Path
        Where bags go.

    """

    def __init__(
        self, stack: ExitStack, camera: CalibratedCamera, images: Sequence[Pixels], folder: Path
    ) -> None:
        stack.enter_context(_only_this_machine())
        self._camera, self._images, self._count = camera, images, 0
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=DOMAIN)
        stack.callback(self._context.try_shutdown)
        self._node = rclpy.create_node('bench_camera', context=self._context)
        stack.callback(self._node.destroy_node)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._image_pub = self._node.create_publisher(Image, 'image_raw', qos.STREAM)
        self._info_pub = self._node.create_publisher(CameraInfo, 'camera_info', qos.STREAM)
        self._desired_pub = self._node.create_publisher(Image, 'desired/image_raw', qos.LATCHED)
        self._node.create_subscription(JointState, 'epipoles', self._on_epipoles, qos.STREAM)
        self._drive = Drive()
        self.processes = {name: _started(stack, name, folder) for name in NODES}

    def show_goal(self, photograph: Pixels) -> None:
        """Publish the photograph, and wait until the servo answers to images."""
        self._desired_pub.publish(write.image(photograph, 'mono8', 0, FRAME_ID))
        deadline = time.monotonic() + START_S
        while not self.drive(1.0, 10.0).latencies:
            if time.monotonic() > deadline:
                raise VisualServoError(f'the servo has not answered within {START_S:g} s')
        self.drive(WARM_UP_S, 10.0)

    def drive(self, seconds: float, rate: float) -> Drive:
        """Publish images for ``seconds`` [s] at ``rate`` [Hz], and return the latencies."""
        self._drive = drive = Drive()
        begin = time.monotonic()
        for number in range(round(seconds * rate)):
            self._spin_until(begin + number / rate)
            self._publish()
        self._spin_until(time.monotonic() + SETTLE_S)
        return drive

    def call(self, service: str) -> str:
        """Call a service of std_srvs/Trigger, and return what it says."""
        client = self._node.create_client(Trigger, service)
        try:
            if not client.wait_for_service(START_S):
                raise VisualServoError(f'nobody has served {service} within {START_S:g} s')
            future: Any = client.call_async(Trigger.Request())
            self._executor.spin_until_future_complete(future, START_S)
            answer = future.result()
        finally:
            self._node.destroy_client(client)
        if answer is None or not answer.success:
            raise VisualServoError(f'{service} failed: {answer and answer.message}')
        return str(answer.message)

    def wait_for_listeners(self, count: int) -> None:
        """Wait until so many subscribe to images."""
        deadline = time.monotonic() + START_S
        while self._image_pub.get_subscription_count() < count:
            self._spin_until(time.monotonic() + 0.05)
            if time.monotonic() > deadline:
                raise VisualServoError(f'images have found no {count} listeners')

    def _publish(self) -> None:
        stamp_ns = self._node.get_clock().now().nanoseconds
        image = self._images[self._count % len(self._images)]
        self._count += 1
        message = write.image(image, 'mono8', stamp_ns, FRAME_ID)
        self._info_pub.publish(write.camera_info(self._camera, stamp_ns, FRAME_ID))
        self._drive.sent[stamp_ns] = time.monotonic()
        self._image_pub.publish(message)

    def _on_epipoles(self, message: JointState) -> None:
        sent = self._drive.sent.get(read.stamp_ns(message.header))
        if sent is not None:
            self._drive.latencies.append(time.monotonic() - sent)

    def _spin_until(self, moment: float) -> None:
        while (remaining := moment - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=remaining)


def memory_mb(process: 'subprocess.Popen[bytes]') -> float:
    """Return the resident memory of a process [MB]."""
    pages = int(Path(f'/proc/{process.pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def processor_s(process: 'subprocess.Popen[bytes]') -> float:
    """Return the processor time that a process has taken [s]."""
    # User and system time are fields 14 and 15; the name before them may hold blanks.
    fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def _started(stack: ExitStack, name: str, folder: Path) -> 'subprocess.Popen[bytes]':
    command = [sys.executable, '-m', f'visual_servo_epipolar.nodes.{name}', '--ros-args']
    process = stack.enter_context(
        subprocess.Popen(
            [*command, *NODES[name]],
            cwd=folder,
            env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN), 'PYTHONPATH': _import_path()},
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    )
    stack.callback(process.terminate)
    return process


def _import_path() -> str:
    return os.pathsep.join(filter(None, map(os.path.abspath, sys.path)))


@contextmanager
def _only_this_machine() -> Iterator[None]:
    tune_transport()
    before = os.environ.get(DISCOVERY)
    os.environ[DISCOVERY] = 'LOCALHOST'
    try:
        yield
    finally:
        del os.environ[DISCOVERY]
        if before is not None:
            os.environ[DISCOVERY] = before
