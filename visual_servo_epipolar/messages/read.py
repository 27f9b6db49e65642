"""
Messages into core values; the fields alone are looked at, so rosbags messages fit too.

Every function raises ValueError for a message that cannot be used.
"""

from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.camera import Camera
from visual_servo_epipolar.core.features import Features
from visual_servo_epipolar.core.motion import Pose, Twist, yaw_from_quaternion
from visual_servo_epipolar.core.stamps import NANOSECONDS

CHANNELS = {'mono8': 1, '8UC1': 1, 'bgr8': 3, 'rgb8': 3, '8UC3': 3}
NUMPY_TYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
TRACK_FIELDS = ('id', 'u', 'v', 'desired_u', 'desired_v', 'age', 'error')


def stamp_ns(header: Any) -> int:
    """Return the stamp of a header [ns]."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def gray(message: Any) -> Image:
    """Return the grey image of a sensor_msgs/Image, uint8 of shape (H, W)."""
    channels = CHANNELS.get(message.encoding)
    if channels is None:
        raise ValueError(
            f'image encoding must be one of {", ".join(CHANNELS)}, got {message.encoding!r}; '
            'convert it before it gets here'
        )
    height, width, row = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1:
        raise ValueError(f'image is empty, {width}x{height}; check the camera driver')
    if row < width * channels or len(message.data) != height * row:
        raise ValueError(
            f'image data must hold {height} rows of {row} bytes, at least {width * channels} '
            f'each, got {len(message.data)} bytes in all; the message is truncated or mislabelled'
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(height, row)[:, : width * channels]
    if channels == 1:
        return np.ascontiguousarray(rows)
    colour = rows.reshape(height, width, 3)
    code = cv2.COLOR_RGB2GRAY if message.encoding == 'rgb8' else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(colour, code))


def camera(message: Any) -> Camera:
    """Return the camera of a sensor_msgs/CameraInfo."""
    k = [float(value) for value in message.k]
    if k[1] != 0.0:
        raise ValueError(f'CameraInfo must have no skew, got K[1] = {k[1]}; calibrate again')
    return Camera(
        int(message.width),
        int(message.height),
        k[0],
        k[4],
        k[2],
        k[5],
        tuple(float(value) for value in message.d),
        message.distortion_model,
    )


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
    strange = [name for name in TRACK_FIELDS if columns[name].datatype not in NUMPY_TYPES]
    if strange:
        raise ValueError(
            f'tracks have fields of no known datatype: {", ".join(strange)}; connect the '
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


def numbers(message: Any) -> dict[str, float]:
    """Return the named numbers of an ``epipoles`` message."""
    return {
        str(name): float(value) for name, value in zip(message.name, message.position, strict=True)
    }


def diagnosis(message: Any) -> dict[str, str]:
    """Return the keys and values of the first status of a DiagnosticArray."""
    if not message.status:
        raise ValueError('diagnostics must have a status, got none; connect those of a servo_node')
    return {str(item.key): str(item.value) for item in message.status[0].values}
