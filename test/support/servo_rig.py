"""A servo node on a bench, fed with tracks one by one; what the robot is told by it."""

from dataclasses import replace
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist as TwistMessage
from geometry_msgs.msg import TwistStamped
import pytest
from sensor_msgs.msg import CameraInfo, JointState, PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.laws.phase import unarmed
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.live_run import LiveRun
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import SimulatedRig

CAMERA = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
WORLD = PointWorld(PointSettings(), SimulatedRig(CAMERA), seed=0)
AWAY, GOAL = Pose.from_start(1.0, -3.5, 8.0), Pose.from_start(0.0, 0.0, 0.0)
IN_VIEW, NOTHING = WORLD.observe(AWAY, 0), Features()
STAMP_NS, PERIOD_NS = 7_000_000_003, 90_909_091
# Stamps of 1970 are driven by, and a test that stops for a moment stops no robot.
REPLAYED = {'autostart': True, 'max_latency': 0.0, 'stale_timeout': 60.0}
MANY = 20  # images that a robot must be told to move by


UNCALIBRATED = write.camera_info(CAMERA, 0, 'camera')
UNCALIBRATED.k[0] = 0.0


def some(count: int) -> Features:
    """Return the first features of those in view."""
    columns = (IN_VIEW.ids, IN_VIEW.current, IN_VIEW.desired, IN_VIEW.ages, IN_VIEW.errors)
    return Features(*(column[:count] for column in columns))


class Rig:
    """A running servo node, fed with tracks one by one; what it is like, its topics tell."""

    goal = NO_GOAL  # of the tracks

    def __init__(self, bench, *, camera=CAMERA, calibrated=True, **values) -> None:
        self.bench, self.stamp_ns = bench, STAMP_NS
        self.world = PointWorld(PointSettings(), SimulatedRig(camera), seed=0)
        self.words = bench.listen(String, 'phase', qos.LATCHED)
        self.reports = bench.listen(DiagnosticArray, '/diagnostics')
        self._telemetry = bench.listen(JointState, 'epipoles')
        kind = TwistStamped if values.get('enable_stamped_cmd_vel') else TwistMessage
        self.commands = bench.listen(kind, 'cmd_vel')
        self.send = bench.talk(PointCloud2, 'tracks')
        self.calibrate = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(ServoNode, **{**REPLAYED, **values})
        if calibrated:
            self.hear(camera)

    def hear(self, camera=CAMERA) -> None:
        """Send camera_info, itself or of a camera, and wait until the node has it."""
        if not isinstance(camera, CameraInfo):
            camera = write.camera_info(camera, self.stamp_ns, 'camera')
        self.calibrate(camera)
        self.bench.settle()

    def twists(self):
        return [read.twist(message) for message in self.commands]

    def tell(self, cloud) -> None:
        """Send tracks, and wait until the node has taken them in."""
        received = self.node.received
        self.send(cloud)
        self.bench.until(lambda: self.node.received > received, 'tracks to arrive')
        self.bench.settle()

    def see(self, pose=AWAY) -> None:
        """Send what the camera sees from ``pose`` as tracks of the next image."""
        self.show(self.world.observe(pose, 0))

    def show(self, features=NOTHING, frame='camera_optical_frame', **said) -> None:
        """Send ``features`` as tracks of the next image; ``said`` of its repetitions."""
        features = replace(features, goal=self.goal)
        self.tell(write.features(features, self.stamp_ns, frame, **said))
        self.stamp_ns += PERIOD_NS

    def drive(self):
        """See until the robot is told to move."""
        for _ in range(MANY):
            told = len(self.commands)
            self.see()
            if any(twist != STANDSTILL for twist in self.twists()[told:]):
                return self
        pytest.fail(f'the robot stands: {self.phase}, {self.reason}')

    def stand(self, images: int = 3) -> None:
        """See images, each of which is answered by a zero twist or none."""
        before = len(self.commands)
        for _ in range(images):
            self.see()
        assert all(twist == STANDSTILL for twist in self.twists()[before:])

    def resume(self, pose=AWAY) -> None:
        """See as many images as a hold takes to end, and drive by the last."""
        for _ in range(RESUMING_FRAMES):
            assert (self.phase, self.twist) == ('holding', STANDSTILL)
            before = len(self.commands)
            self.see(pose)
        assert any(twist != STANDSTILL for twist in self.twists()[before:])

    @property
    def run(self) -> LiveRun:
        """The run of the node, for what no message brings about in a moment."""
        return self.node._live

    def told(self, *messages) -> None:
        """Hand it what tf2_msgs/TFMessage would bring, which the wheels of ROS 2 are without."""
        self.node._camera.static_mount.receive(SimpleNamespace(transforms=list(messages)))

    def watch(self) -> None:
        """Let the watchdog look now."""
        self.node._on_watch()

    def idle(self) -> None:
        """Let the servo look now at what it looks at once a second."""
        self.node._on_idle()

    @property
    def telemetry(self) -> dict[str, float]:
        """What the servo measured in the last step, by name."""
        self.bench.settle()
        return read.telemetry(self._telemetry[-1])

    @property
    def twist(self) -> Twist:
        """The last command, to stand where there was none."""
        return self.twists()[-1] if self.commands else STANDSTILL

    @property
    def phase(self) -> str:
        """The phase, as the servo says it now."""
        self.bench.settle()
        return unarmed(self.words[-1].data)

    @property
    def drives(self) -> bool:
        """Whether the phase is one of a robot that drives."""
        return phase_named(self.phase).drives

    @property
    def reason(self) -> str:
        """Why the robot is in its phase, by the last diagnostics of the servo."""
        self.bench.settle()
        name = self.node.get_fully_qualified_name()
        return next(
            read.diagnosis(item)['reason']
            for item in reversed(self.reports)
            if item.status[0].name == name
        )


def tracks(pose=AWAY, stamp_ns=STAMP_NS):
    return write.features(WORLD.observe(pose, 0), stamp_ns, 'camera_optical_frame')
