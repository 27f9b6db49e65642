"""Writing: core values into messages, every scalar as float or int: rclpy checks nothing."""

import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState, PointCloud2, PointField
from std_msgs.msg import Header, String

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose, quaternion_from_yaw, Twist
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.features import Features

TRACK_LAYOUT = np.dtype(
    [
        ('id', '<u4'),
        ('u', '<f8'),
        ('v', '<f8'),
        ('desired_u', '<f8'),
        ('desired_v', '<f8'),
        ('age', '<u4'),
        ('error', '<f8'),
        ('goal', '<u4'),
        ('repeats', '<u4'),
        ('back', '<u4'),
    ]
)
UNMEASURED = 1e6  # variance of an axis that nothing measures, by the custom of ROS
PLANAR = 0, 1, 5  # x, y and yaw among the rows of a covariance: x, y, z, turns about them
POINT_TYPES = {'<u4': PointField.UINT32, '<f8': PointField.FLOAT64}
TRACK_FIELDS = tuple(
    {'name': name, 'offset': int(item[1]), 'datatype': POINT_TYPES[item[0].str], 'count': 1}
    for name, item in (TRACK_LAYOUT.fields or {}).items()
)


def stamp(stamp_ns: int) -> Time:
    """Return a time [ns] as a message; the first or last that there is of any beyond."""
    # Of 2^32 - 1 ns beside the last second, as a driver may send: no node may end by it.
    whole = np.iinfo(np.int32)
    stamp_ns = min(max(stamp_ns, whole.min * NANOSECONDS), (whole.max + 1) * NANOSECONDS - 1)
    return Time(sec=int(stamp_ns // NANOSECONDS), nanosec=int(stamp_ns % NANOSECONDS))


def header(stamp_ns: int, frame_id: str) -> Header:
    """Return a header."""
    return Header(stamp=stamp(stamp_ns), frame_id=frame_id)


def clock(stamp_ns: int) -> Clock:
    """Return a /clock message."""
    return Clock(clock=stamp(stamp_ns))


def image(pixels: np.ndarray, encoding: str, stamp_ns: int, frame_id: str) -> Image:
    """Return a sensor_msgs/Image of uint8 ``pixels``, shape (H, W) or (H, W, 3)."""
    pixels = np.ascontiguousarray(pixels)
    message = Image(header=header(stamp_ns, frame_id), encoding=encoding)
    message.height, message.width = int(pixels.shape[0]), int(pixels.shape[1])
    message.step = int(pixels.strides[0])
    message.data.frombytes(pixels)  # one copy; assigning numpy or a memoryview takes 100 ms
    return message


def camera_info(camera: CameraModel, stamp_ns: int, frame_id: str) -> CameraInfo:
    """Return a sensor_msgs/CameraInfo: R is the identity, P is K with a fourth column of zeros."""
    message = CameraInfo(header=header(stamp_ns, frame_id))
    message.width, message.height = camera.width, camera.height
    message.distortion_model = camera.distortion_model
    message.d = [float(value) for value in camera.distortion]
    message.k = camera.matrix.ravel()
    message.r = np.eye(3).ravel()
    message.p = np.column_stack([camera.matrix, np.zeros(3)]).ravel()
    return message


def twist(value: Twist) -> TwistMessage:
    """Return a geometry_msgs/Twist."""
    message = TwistMessage()
    message.linear.x, message.angular.z = float(value.linear), float(value.angular)
    return message


def twist_stamped(value: Twist, stamp_ns: int, frame_id: str) -> TwistStamped:
    """Return a geometry_msgs/TwistStamped."""
    return TwistStamped(header=header(stamp_ns, frame_id), twist=twist(value))


def twist_type(*, stamped: bool) -> Any:
    """Return the type of commands to a base, geometry_msgs/TwistStamped or Twist."""
    return TwistStamped if stamped else TwistMessage


def command(
    value: Twist, stamp_ns: int, frame_id: str, *, stamped: bool
) -> TwistStamped | TwistMessage:
    """Return a command to a base, of that type."""
    return twist_stamped(value, stamp_ns, frame_id) if stamped else twist(value)


def odometry(
    pose: Pose,
    velocity: Twist,
    stamp_ns: int,
    frame_id: str,
    child_frame_id: str,
    *,
    pitch: tuple[float, float] = (0.0, 0.0),
    pose_covariance: FloatArray | None = None,
    twist_covariance: FloatArray | None = None,
) -> Odometry:
    """
    Return a nav_msgs/Odometry: pose in ``frame_id``, velocity in ``child_frame_id``.

    ``pitch``, nose down positive [rad], and its rate [rad/s] are those of a body that nods.
    Covariances, (3, 3) of x, y [m], yaw [rad] and (2, 2) of linear [m/s], angular [rad/s], leave
    the other axes unmeasured; None is the truth, exact in all of them.
    """
    message = Odometry(header=header(stamp_ns, frame_id), child_frame_id=child_frame_id)
    message.pose.pose = planar_pose(pose.x, pose.y, pose.theta)
    message.twist.twist = twist(velocity)
    message.twist.twist.angular.y = pitch[1]
    if pitch[0]:
        turn, half = message.pose.pose.orientation, 0.5 * pitch[0]
        sine, cosine = math.sin(half), math.cos(half)
        turn.x, turn.y, turn.z, turn.w = (
            -sine * turn.z,
            sine * turn.w,
            cosine * turn.z,
            cosine * turn.w,
        )
    if pose_covariance is not None:
        message.pose.covariance = covariance(pose_covariance)
    if twist_covariance is not None:
        message.twist.covariance = covariance(twist_covariance, PLANAR[::2])
    return message


def planar_pose(x: float, y: float, yaw: float) -> PoseMessage:
    """Return a geometry_msgs/Pose on the floor: x, y [m], yaw [rad]."""
    message = PoseMessage()
    message.position.x, message.position.y = float(x), float(y)
    turn = message.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion_from_yaw(yaw)
    return message


def pose_stamped(value: FloatArray, stamp_ns: int, frame_id: str) -> PoseStamped:
    """Return a pose in the plane, (3,): x, y [m], yaw [rad], as a geometry_msgs/PoseStamped."""
    return PoseStamped(header=header(stamp_ns, frame_id), pose=planar_pose(*value.tolist()))


def pose_with_covariance(
    value: tuple[FloatArray, FloatArray], stamp_ns: int, frame_id: str
) -> PoseWithCovarianceStamped:
    """Return a pose in the plane, (3,): x, y [m], yaw [rad], with its covariance, (3, 3)."""
    message = PoseWithCovarianceStamped(header=header(stamp_ns, frame_id))
    message.pose.pose = planar_pose(*value[0].tolist())
    message.pose.covariance = covariance(value[1])
    return message


def covariance(measured: FloatArray, axes: tuple[int, ...] = PLANAR) -> FloatArray:
    """Return the 36 numbers, row by row, of a covariance in which only ``axes`` are measured."""
    whole = np.diag(np.full(6, UNMEASURED))
    whole[np.ix_(axes, axes)] = measured
    return whole.ravel()


def features(
    value: Features, stamp_ns: int, frame_id: str, *, repeats: int = 0, back: int = 0
) -> PointCloud2:
    """
    Return tracks as a sensor_msgs/PointCloud2, a row a feature.

    The height is 0 where there is no photograph, also of empty tracks, which have no row to tell
    its goal. ``repeats``: how many images in a row have been the very same; ``back``: how many
    images ago it came last, 0 if it is new.
    """
    rows = np.empty(len(value), TRACK_LAYOUT)
    rows['id'], rows['age'], rows['error'] = value.ids, value.ages, value.errors
    rows['u'], rows['v'] = value.current.T
    rows['desired_u'], rows['desired_v'] = value.desired.T
    rows['goal'], rows['repeats'], rows['back'] = value.goal, repeats, back
    height = int(value.goal != NO_GOAL or len(rows) > 0)
    message = PointCloud2(header=header(stamp_ns, frame_id), height=height, width=len(rows))
    message.fields = [PointField(**field) for field in TRACK_FIELDS]
    message.is_dense, message.point_step = True, TRACK_LAYOUT.itemsize
    message.row_step = message.point_step * len(rows)
    message.data.frombytes(rows.tobytes())
    return message


def telemetry(values: dict[str, float], stamp_ns: int, frame_id: str) -> JointState:
    """
    Return telemetry, values by name, with a stamp.

    JointState is the one stock message that carries them and that plotting tools show by name;
    ``position`` holds the values.
    """
    message = JointState(header=header(stamp_ns, frame_id))
    message.name = list(values)
    message.position = [float(value) for value in values.values()]
    return message


def text(value: str) -> String:
    """Return a std_msgs/String."""
    return String(data=value)


def diagnostics(
    name: str, *, level: bytes, summary: str, values: dict[str, Any], stamp_ns: int
) -> DiagnosticArray:
    """Return a diagnostic_msgs/DiagnosticArray with one status."""
    status = DiagnosticStatus(level=level, name=name, message=summary)
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticArray(header=header(stamp_ns, ''), status=[status])
