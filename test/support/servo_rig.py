"""A servo node on a bench, fed with tracks one by one; what the robot is told by it."""

from types import SimpleNamespace

from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

CAMERA = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
WORLD = PointWorld(PointSettings(), FixedRig(CAMERA), seed=0)
AWAY, GOAL = Pose.from_start(1.0, -3.5, 8.0), Pose.from_start(0.0, 0.0, 0.0)
STAMP_NS, PERIOD_NS = 7_000_000_003, 90_909_091
REPLAYED = {'autostart': True, 'max_latency': 0.0}  # stamps of 1970 are driven by
MANY = 20  # images that a robot must be told to move by


class HandSetClock:
    """A steady clock that is set by hand [ns]."""

    now_ns = 10**9

    def now(self) -> SimpleNamespace:
        return SimpleNamespace(nanoseconds=self.now_ns)


class Rig:
    """A running servo node, fed with tracks one by one."""

    def __init__(self, bench, *, calibrated=True, **values) -> None:
        self.bench, self.stamp_ns = bench, STAMP_NS
        kind = TwistStamped if values.get('enable_stamped_cmd_vel') else TwistMessage
        self.commands = bench.listen(kind, 'cmd_vel')
        self.send = bench.talk(PointCloud2, 'tracks')
        self.calibrate = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(ServoNode, **{**REPLAYED, **values})
        if calibrated:
            self.calibrate(write.camera_info(CAMERA, 0, 'camera'))
            bench.until(lambda: self.node._camera.model is not None, 'camera_info to arrive')

    def twists(self):
        return [read.twist(message) for message in self.commands]

    def tell(self, cloud) -> None:
        """Send tracks, and wait until the node has taken them in."""
        received = self.node.received
        self.send(cloud)
        self.bench.until(lambda: self.node.received > received, 'tracks to arrive')
        self.bench.settle()

    def see(self, pose=AWAY) -> None:
        self.tell(tracks(pose, self.stamp_ns))
        self.stamp_ns += PERIOD_NS

    def drive(self):
        """See until the robot is told to move."""
        for _ in range(MANY):
            self.see()
            if self.node._state.twist != STANDSTILL:
                return self
        pytest.fail(f'the robot stands: {self.phase}, {self.node._state.reason}')

    @property
    def phase(self) -> str:
        return self.node._state.phase.value


def tracks(pose=AWAY, stamp_ns=STAMP_NS):
    return write.features(WORLD.observe(pose, 0), stamp_ns, 'camera_optical_frame')
