"""A route node on a bench, fed with images one by one; what the robot is told by it."""

from pathlib import Path
from typing import Any

from bench import Bench
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
from recorded_drives import RecordedDrive, Seen
from sensor_msgs.msg import CameraInfo, Image

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.route_node import RouteNode


class RouteRig:
    """
    A running route node with the route in ``folder``, if that is there, and its ``camera``.

    There is no camera_info where that is None.
    """

    def __init__(
        self, bench: Bench, folder: Path, camera: CameraModel | None, **values: Any
    ) -> None:
        self.bench, self.stamp_ns = bench, 0
        self.commands = bench.listen(TwistMessage, 'cmd_vel')
        self.diagnoses = bench.listen(DiagnosticArray, '/diagnostics')
        self._send = bench.talk(Image, 'image_raw')
        self._calibrate = bench.talk(CameraInfo, 'camera_info')
        self._move = bench.talk(Odometry, 'odom')
        values = {'route': str(folder), 'max_latency': 0.0, 'law': 'smooth', **values}
        self.node = bench.start(RouteNode, **values)
        if camera is not None:
            self.calibrate(camera)

    def calibrate(self, camera: CameraModel) -> None:
        """Publish a calibration, and wait until the node has it."""
        self._calibrate(write.camera_info(camera, self.stamp_ns, 'camera'))
        self.bench.settle()

    def see(
        self, image: Pixels, stamp_ns: int | None = None, odometry: Pose | None = None
    ) -> None:
        """Publish an image, and wait until the node has taken it in."""
        self.stamp_ns = self.stamp_ns + 90_000_000 if stamp_ns is None else stamp_ns
        if odometry is not None:
            self._move(write.odometry(odometry, STANDSTILL, self.stamp_ns, 'odom', 'base_link'))
        received = self.node.received
        self._send(write.image(image, 'mono8', self.stamp_ns, 'camera'))
        self.bench.until(lambda: self.node.received > received, 'an image to arrive')

    def record(self, drive: RecordedDrive) -> tuple[bool, str]:
        """Record a drive, message by message; return what ``~/stop_recording`` answers."""
        assert self.call('start_recording')[0]
        self.tell(drive)
        self.bench.settle()
        return self.call('stop_recording')

    def tell(self, drive: RecordedDrive) -> None:
        """Publish what came of a drive, each when the node has taken in the one before."""
        for each in sorted([*drive.odometry, *drive.images], key=lambda it: it.came_ns):
            if isinstance(each, Seen):
                self.see(each.image, each.stamp_ns)
            else:
                told = each.pose, STANDSTILL, each.stamp_ns, each.frame, 'base_link'
                self._move(write.odometry(*told))
                self.bench.until(
                    lambda ns=each.stamp_ns: self.node._driven.path.lag(ns) == 0.0,
                    'odometry to arrive',
                )

    def answered(self, image: Pixels, stamp_ns: int) -> Twist:
        """Return the command that an image is answered by, where each one is."""
        told = len(self.commands)
        self.see(image, stamp_ns)
        self.bench.until(lambda: len(self.commands) > told, 'a command')
        assert len(self.commands) == told + 1
        return read.twist(self.commands[-1])

    def call(self, service: str) -> tuple[bool, str]:
        """Call a service of the node; return whether it succeeded, and what it says."""
        response = self.bench.call(f'/route_node/{service}')
        return response.success, response.message

    @property
    def reason(self) -> str:
        """Why the robot stands, by the last step."""
        return str(self.node._repetition.last.reason)

    @property
    def stands(self) -> bool:
        """Whether the last command was to stand, or there was none."""
        return not self.commands or read.twist(self.commands[-1]) == STANDSTILL
