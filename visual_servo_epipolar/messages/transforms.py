"""Coordinate frames as transforms in messages."""

from collections.abc import Sequence
from importlib import import_module
import math
from typing import Any

from geometry_msgs.msg import TransformStamped
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Pose, quaternion_from_yaw
from visual_servo_epipolar.messages import write


def tf_message_class() -> Any | None:
    """Return tf2_msgs/TFMessage, or None: the wheels of ROS 2 are without it."""
    try:
        return import_module('tf2_msgs.msg').TFMessage
    except ImportError:
        return None


def without_tf2_msgs(consequence: str) -> str:
    """Return what a node says that misses tf2_msgs: ``consequence``, and how to mend it."""
    return f'tf2_msgs cannot be imported, {consequence}; install ros-jazzy-tf2-msgs for it'


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
