"""A dock node, and a robot that drives towards the photograph with perfect odometry."""

from diagnostic_msgs.msg import DiagnosticArray
from docking_drives import CAMERA, PERIOD_NS, PERIOD_S
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.dock_node import DockNode
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import SimulatedRig

FRAMES = 10
TWIST = Twist(0.4, 0.05)
START = Pose.from_start(0.3, -2.0, 4.0)


class Rig:
    """A dock node, and a robot that drives towards the photograph with perfect odometry."""

    def __init__(self, bench, kind=DockNode, *, calibrated=True, **values) -> None:
        self.bench = bench
        self.poses = bench.listen(PoseStamped, 'detected_dock_pose')
        self.uncertain = bench.listen(
            PoseWithCovarianceStamped, 'detected_dock_pose_with_covariance'
        )
        self._reports = bench.listen(DiagnosticArray, '/diagnostics')
        self.tracks = bench.talk(PointCloud2, 'tracks')
        self.odometry = bench.talk(Odometry, 'odom')
        self.info = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(kind, **values)
        self.world = PointWorld(PointSettings(), SimulatedRig(CAMERA), seed=0)
        self.pose, self.told, self.frame = START, Pose(5.0, 3.0, 1.0), 0
        if calibrated and self.node.is_active:
            self.calibrate()

    @property
    def reports(self):
        """What the dock node reports: a servo does on that topic, too."""
        return [it for it in self._reports if it.status[0].name == '/dock_node']

    def calibrate(self, camera=CAMERA) -> None:
        self.info(write.camera_info(camera, 0, 'camera'))
        self.bench.settle()

    @property
    def stamp_ns(self) -> int:
        return (self.frame + 1) * PERIOD_NS

    def tell_odometry(self) -> None:
        message = write.odometry(self.told, TWIST, self.stamp_ns, 'odom', 'base_link')
        self.odometry(message)

    def see(self) -> None:
        features = self.world.observe(self.pose, self.frame)
        self.tracks(write.features(features, self.stamp_ns, 'camera'))

    def step(self) -> None:
        """See, hear of it, and drive on."""
        count = len(self.reports)
        self.tell_odometry()
        self.see()
        self.bench.until(lambda: len(self.reports) > count, 'the tracks to be looked at')
        self.advance()

    def advance(self) -> None:
        """Drive on by one frame."""
        self.frame += 1
        self.before = self.pose
        self.pose = integrate(self.pose, TWIST, PERIOD_S)
        self.told = integrate(self.told, TWIST, PERIOD_S)

    def drive(self, frames=FRAMES):
        """Drive, and return how many poses were published on the way."""
        count = len(self.poses)
        for _ in range(frames):
            self.step()
        self.bench.settle()
        return len(self.poses) - count
