"""Coordinate frames as messages: transforms, and markers where no other node publishes any."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
import math
from typing import Any

from geometry_msgs.msg import Point, TransformStamped
import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Pose, quaternion_from_yaw
from visual_servo_epipolar.messages import write

AXIS_M, LINE_M, LETTER_M = 0.3, 0.02, 0.1
COLOURS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # x, y, z by REP 103


def tf_message_class() -> Any | None:
    """Return tf2_msgs/TFMessage, or None: the wheels of ROS 2 are without it."""
    try:
        return import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return None


def without_tf2_msgs(consequence: str) -> str:
    """Return what a node says that misses tf2_msgs: ``consequence``, and how to mend it."""
    return f'tf2_msgs cannot be imported, {consequence}; install ros-jazzy-tf2-msgs for it'


def tf_message(kind: Any, transforms: Sequence[TransformStamped]) -> Any:
    """Return ``transforms`` as one message of ``kind``, tf2_msgs/TFMessage."""
    return kind(transforms=list(transforms))


def on_the_floor(parent: str, child: str, pose: Pose, stamp_ns: int) -> TransformStamped:
    """Return the transform to ``child``, which stands at ``pose`` in ``parent``, z up."""
    quaternion = quaternion_from_yaw(pose.theta)
    return _transform(parent, child, (pose.x, pose.y, 0.0), quaternion, stamp_ns)


def mount_transform(
    parent: str, child: str, R_parent_child: FloatArray, origin: FloatArray
) -> TransformStamped:
    """Return the transform that never changes: rotation (3, 3), and origin (3,) in ``parent``."""
    return _transform(parent, child, origin, _quaternion(R_parent_child), 0)


def _transform(
    parent: str,
    child: str,
    origin: Sequence[float] | FloatArray,
    quaternion: Sequence[float],
    stamp_ns: int,
) -> TransformStamped:
    message = TransformStamped(header=write.header(stamp_ns, parent), child_frame_id=child)
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = map(float, origin)
    turn.x, turn.y, turn.z, turn.w = map(float, quaternion)
    return message


def _quaternion(rotation: FloatArray) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w), w not negative, of a rotation matrix."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.asarray(rotation, dtype=np.float64).tolist()
    # The eigenvector of the largest eigenvalue (Bar-Itzhack): no case for any angle.
    symmetric = np.array(
        [
            [xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, yy - xx - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    x, y, z, w = np.linalg.eigh(symmetric)[1][:, 3].tolist()
    sign = math.copysign(1.0, w)
    return sign * x, sign * y, sign * z, sign * w


@dataclass(frozen=True, slots=True, eq=False)
class FrameAxes:
    """Coordinate frame: ``axes``, shape (3, 3), columns x, y, z; ``origin``, shape (3,) [m]."""

    name: str
    axes: FloatArray
    origin: FloatArray


def upright(name: str, pose: Pose) -> FrameAxes:
    """Return the frame of what stands on the floor at ``pose``: x ahead, y left, z up."""
    sin, cos = math.sin(pose.theta), math.cos(pose.theta)
    axes = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return FrameAxes(name, axes, np.array([pose.x, pose.y, 0.0]))


def frames(coordinate_frames: Sequence[FrameAxes], stamp_ns: int, frame_id: str) -> MarkerArray:
    """Return three coloured lines and a name for each frame, all in ``frame_id``."""
    array = MarkerArray()
    for number, frame in enumerate(coordinate_frames):
        array.markers.append(_axes(2 * number, frame))
        array.markers.append(_name(2 * number + 1, frame))
    for marker in array.markers:
        marker.header, marker.ns = write.header(stamp_ns, frame_id), 'frames'
        marker.pose.orientation.w = 1.0
    return array


def _axes(number: int, frame: FrameAxes) -> Marker:
    marker = Marker(id=number, type=Marker.LINE_LIST)
    marker.scale.x, marker.color.a = LINE_M, 1.0
    for axis, (red, green, blue) in zip(frame.axes.T, COLOURS, strict=True):
        marker.points += [_point(frame.origin), _point(frame.origin + AXIS_M * axis)]
        marker.colors += [ColorRGBA(r=red, g=green, b=blue, a=1.0)] * 2
    return marker


def _name(number: int, frame: FrameAxes) -> Marker:
    marker = Marker(id=number, type=Marker.TEXT_VIEW_FACING, text=frame.name)
    marker.pose.position = _point(frame.origin + (0.0, 0.0, -LETTER_M))
    marker.scale.z = LETTER_M
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = 0.6, 0.6, 0.6, 1.0
    return marker


def _point(place: FloatArray) -> Point:
    x, y, z = np.asarray(place, dtype=np.float64).tolist()
    return Point(x=x, y=y, z=z)
