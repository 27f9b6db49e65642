"""Reports of the dock node: the dock's pose, how sure it is, and why there is none."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node

from visual_servo_epipolar.core.docking.dock_pose import DockPose
from visual_servo_epipolar.core.docking.path import PathPlace
from visual_servo_epipolar.core.docking.search import DockSearch
from visual_servo_epipolar.core.geometry.planar_poses import compose
from visual_servo_epipolar.messages import docking, write
from visual_servo_epipolar.nodes import qos


class DockReports:
    """Reports of the dock node ``node``; poses are in its ``base_frame``, unless in odometry's."""

    def __init__(self, node: Node, base_frame: str) -> None:
        self._name, self._base_frame = node.get_fully_qualified_name(), base_frame
        self._pose_pub = node.create_publisher(PoseStamped, 'detected_dock_pose', qos.STREAM)
        self._covariance_pub = node.create_publisher(
            PoseWithCovarianceStamped, 'detected_dock_pose_with_covariance', qos.STREAM
        )
        self._diagnostics_pub = node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )

    def pose(self, dock: DockPose, place: PathPlace, path_frame: str | None) -> None:
        """Publish the pose as seen from ``place``; in ``path_frame``, if any."""
        frame, pose, covariance = self._base_frame, dock.pose, dock.covariance
        if path_frame is not None:
            frame, pose = path_frame, compose(place.pose, pose)
            covariance = dock.turned(place.pose[2])
        self._pose_pub.publish(docking.pose(pose, dock.stamp_ns, frame))
        self._covariance_pub.publish(
            docking.pose_with_covariance(pose, covariance, dock.stamp_ns, frame)
        )

    def search(self, search: DockSearch, stamp_ns: int) -> None:
        """Publish how far the search has come."""
        values: dict[str, object] = {
            'unpublished_because': search.reason,
            'views': len(search.keys),
        }
        if search.estimate is not None:
            values['deviation_m'] = round(search.estimate.deviation, 4)
            values['heading_deviation_rad'] = round(search.estimate.heading_deviation, 5)
        self._diagnostics_pub.publish(
            write.diagnostics(
                self._name,
                level=DiagnosticStatus.WARN if search.reason else DiagnosticStatus.OK,
                summary=search.reason or 'the dock is seen',
                values=values,
                stamp_ns=stamp_ns,
            )
        )
