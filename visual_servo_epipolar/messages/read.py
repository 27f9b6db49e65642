"""
Reading: messages into core values, by their fields alone, so that rosbags messages fit too.

Every function raises ValueError for a message that cannot be used.
"""

from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, Twist, yaw_from_quaternion
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages.encodings import gray_from_compressed, gray_from_raw

NUMPY_TYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
TRACK_FIELDS = ('id', 'u', 'v', 'desired_u', 'desired_v', 'age', 'error')


def stamp_ns(header: Any) -> int:
    """Return the stamp of a header [ns]."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def gray(message: Any) -> Image:
    """
    Return the grey image of a sensor_msgs/Image or CompressedImage, uint8 of shape (H, W).

    See ``encodings`` for what is understood.
    """
    return gray_from_compressed(message) if hasattr(message, 'format') else gray_from_raw(message)


def camera(message: Any) -> Camera:
    """Return the camera of a sensor_msgs/CameraInfo, of ROS 1 as well, where K is a capital."""
    matrix, distortion = _calibration(message)
    k = [float(value) for value in matrix]
    if k[1] != 0.0:
        raise ValueError(f'CameraInfo must have no skew, got K[1] = {k[1]}; calibrate again')
    return Camera(
        int(message.width),
        int(message.height),
        k[0],
        k[4],
        k[2],
        k[5],
        tuple(float(value) for value in distortion),
        message.distortion_model,
    )


def _calibration(message: Any) -> tuple[Any, Any]:
    return (message.k, message.d) if hasattr(message, 'k') else (message.K, message.D)


def twist(message: Any) -> Twist:
    """Return the velocity of a geometry_msgs/Twist or TwistStamped."""
    body = getattr(message, 'twist', message)
    return Twist(float(body.linear.x), float(body.angular.z))


def pose(message: Any) -> Pose:
    """Return the pose in the plane of a nav_msgs/Odometry."""
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    yaw = yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Pose(float(position.x), float(position.y), yaw)


def features(message: Any) -> Features:
    """Return the features of a sensor_msgs/PointCloud2 as the tracker publishes it."""
    columns = {field.name: field for field in message.fields}
    missing = [name for name in TRACK_FIELDS if name not in columns]
    if missing:
        raise ValueError(
            f'tracks must have the fields {", ".join(TRACK_FIELDS)}, missing '
            f'{", ".join(missing)}; connect the tracks of a tracker_node'
        )
    unsupported = [name for name in TRACK_FIELDS if columns[name].datatype not in NUMPY_TYPES]
    if unsupported:
        raise ValueError(
            f'tracks have fields of no known datatype: {", ".join(unsupported)}; connect the '
            'tracks of a tracker_node'
        )
    order = '>' if message.is_bigendian else '<'
    layout = np.dtype(
        {
            'names': list(TRACK_FIELDS),
            'formats': [order + NUMPY_TYPES[columns[name].datatype] for name in TRACK_FIELDS],
            'offsets': [int(columns[name].offset) for name in TRACK_FIELDS],
            'itemsize': int(message.point_step),
        }
    )
    count = int(message.width) * int(message.height)
    if len(message.data) != count * layout.itemsize:
        raise ValueError(
            f'tracks must hold {count} rows of {layout.itemsize} bytes, got {len(message.data)} '
            'bytes; the message is truncated'
        )
    rows = np.frombuffer(message.data, layout, count=count)
    return Features(
        ids=rows['id'].astype(np.int64),
        current=np.stack([rows['u'], rows['v']], axis=1).astype(np.float64),
        desired=np.stack([rows['desired_u'], rows['desired_v']], axis=1).astype(np.float64),
        ages=rows['age'].astype(np.int64),
        errors=rows['error'].astype(np.float64),
    )


def telemetry(message: Any) -> dict[str, float]:
    """Return the telemetry in an ``epipoles`` message: values by name."""
    return {
        str(name): float(value) for name, value in zip(message.name, message.position, strict=True)
    }


def diagnosis(message: Any) -> dict[str, str]:
    """Return the keys and values of the first status of a DiagnosticArray."""
    if not message.status:
        raise ValueError('diagnostics must have a status, got none; connect those of a servo_node')
    return {str(item.key): str(item.value) for item in message.status[0].values}
