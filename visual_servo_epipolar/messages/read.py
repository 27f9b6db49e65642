"""
Reading: messages into core values, by their fields alone, so that rosbags messages fit too.

Every function raises ValueError for a message that cannot be used.
"""

from collections.abc import Mapping
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import refuse_implausible
from visual_servo_epipolar.core.cameras.registry import (
    calibrated_camera,
    checked_matrix,
    scaled,
    with_intrinsics,
)
from visual_servo_epipolar.core.geometry.motion import Pose, Twist, yaw_from_quaternion
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import encodings

NUMPY_TYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
UNIT = 1e-2  # error of the length of a quaternion that somebody typed
BETWEEN = 'between_images'  # the key of a diagnosis that no image led to
TRACK_FIELDS = ('id', 'u', 'v', 'desired_u', 'desired_v', 'age', 'error')


def stamp_ns(header: Any) -> int:
    """Return the stamp of a header [ns]."""
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def gray(message: Any) -> Image:
    """Return the grey image of a sensor_msgs/Image or CompressedImage, uint8 of shape (H, W)."""
    read = encodings.compressed if hasattr(message, 'format') else encodings.raw
    return read(message)


def camera(message: Any, *, rectified: bool = False, cropped: bool = False) -> CameraModel:
    """
    Return the camera of a sensor_msgs/CameraInfo.

    K and P are those of the full image: the region of interest shifts them, then binning scales
    them (REP 104). With ``rectified`` images P holds, and the distortion does not apply. Images
    that are ``cropped`` without a region of interest have their principal point anywhere.
    """
    lens = tuple(float(value) for value in message.d), str(message.distortion_model)
    k = [float(value) for value in message.k]
    if rectified:
        if message.p[0] == 0.0:
            raise ValueError(
                'P of camera_info must be set if images are rectified, got P[0] = 0; '
                'calibrate the camera, or set rectified: false for raw images'
            )
        k, lens = checked_matrix(message.p, 'P').ravel().tolist(), ((), 'plumb_bob')
    full = calibrated_camera((int(message.width), int(message.height)), k, *lens)
    try:
        refuse_implausible(full, cropped=cropped)
    except ValueError as error:
        if _is_whole(message):
            raise
        raise ValueError(
            f'{error}; K must be that of the image before region and binning'
        ) from None
    return full if _is_whole(message) else _in_the_image(message, full)


def _is_whole(message: Any) -> bool:
    """Return whether the image is sent as it was taken, neither cut nor binned."""
    roi = message.roi
    steps = roi.x_offset, roi.y_offset, message.binning_x // 2, message.binning_y // 2
    return not any(steps) and {roi.width, roi.height} <= {0}


def _in_the_image(message: Any, camera: CameraModel) -> CameraModel:
    """Return the camera of the image that is sent, of that of the full image."""
    roi = message.roi
    left, top = int(roi.x_offset), int(roi.y_offset)
    width = int(roi.width) or camera.width - left
    height = int(roi.height) or camera.height - top
    if left + width > camera.width or top + height > camera.height:
        raise ValueError(
            f'the region of interest must lie in the image of {camera.width}x{camera.height} px, '
            f'got {width}x{height} px at {left}, {top}; it counts pixels before binning'
        )
    cut = with_intrinsics(
        camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top
    )
    u, v = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    return cut if u == v == 1 else scaled(cut, (width // u, height // v), 1.0 / u, 1.0 / v)


def twist(message: Any) -> Twist:
    """Return the velocity of a geometry_msgs/Twist or TwistStamped."""
    body = getattr(message, 'twist', message)
    return Twist(float(body.linear.x), float(body.angular.z))


def pose(message: Any) -> Pose:
    """Return the pose in the plane of a nav_msgs/Odometry."""
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    length = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if not abs(length - 1.0) < UNIT:
        raise ValueError(
            f'the orientation of odom must be a quaternion of length 1, got length {length:g}; '
            'correct its publisher'
        )
    yaw = yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Pose(float(position.x), float(position.y), yaw)


def pitch(message: Any) -> tuple[float, float]:
    """Return the pitch of a nav_msgs/Odometry, nose down positive [rad], and its rate [rad/s]."""
    turn = message.pose.pose.orientation
    sine = 2.0 * (turn.w * turn.y - turn.z * turn.x)
    return math.asin(min(max(sine, -1.0), 1.0)), float(message.twist.twist.angular.y)


def transform(message: Any) -> tuple[FloatArray, FloatArray]:
    """Return rotation, (3, 3), and origin, (3,) [m], of the child of a TransformStamped."""
    place, turn = message.transform.translation, message.transform.rotation
    origin = np.array([place.x, place.y, place.z])
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    length = float(np.sqrt(quaternion @ quaternion))
    if not (np.isfinite(origin).all() and abs(length - 1.0) < UNIT):
        raise ValueError(
            f'the transform to {message.child_frame_id} must be finite, with a quaternion of '
            f'length 1, got length {length:g}; correct its publisher'
        )
    x, y, z, w = (quaternion / length).tolist()
    rotation = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.array(rotation), origin


def features(message: Any) -> Features:
    """
    Return the features of a sensor_msgs/PointCloud2 as the tracker publishes it.

    Rows without desired pixels, nan both, of earlier versions, are left out.
    """
    layout = _layout_of_tracks(message)
    count = int(message.width) * int(message.height)
    if len(message.data) != count * layout.itemsize:
        raise ValueError(
            f'tracks must hold {count} rows of {layout.itemsize} bytes, got {len(message.data)} '
            'bytes; the message is truncated'
        )
    every = np.frombuffer(message.data, layout, count=count)
    unshown = np.isnan(every['desired_u']) & np.isnan(every['desired_v'])
    rows = every[~unshown]
    return Features(
        ids=rows['id'].astype(np.int64),
        current=np.stack([rows['u'], rows['v']], axis=1).astype(np.float64),
        desired=np.stack([rows['desired_u'], rows['desired_v']], axis=1).astype(np.float64),
        ages=rows['age'].astype(np.int64),
        errors=rows['error'].astype(np.float64),
        goal=_of_first_row(message, 'goal') or NO_GOAL,
    )


def _layout_of_tracks(message: Any) -> np.dtype[np.void]:
    """Return how a row of tracks lies in memory; raises ValueError where a field is missing."""
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
            f'tracks have fields of unknown datatype: {", ".join(unsupported)}; connect the '
            'tracks of a tracker_node'
        )
    order = '>' if message.is_bigendian else '<'
    return np.dtype(
        {
            'names': list(TRACK_FIELDS),
            'formats': [order + NUMPY_TYPES[columns[name].datatype] for name in TRACK_FIELDS],
            'offsets': [int(columns[name].offset) for name in TRACK_FIELDS],
            'itemsize': int(message.point_step),
        }
    )


def goal(message: Any) -> int | None:
    """
    Return the id of the goal that tracks are of, None where nothing tells it.

    Other trackers have no such field, and empty tracks no row.
    """
    return _of_first_row(message, 'goal') or None


def has_photograph(message: Any) -> bool:
    """Return whether the tracker has a photograph, whether it is in view or not."""
    return int(message.height) > 0


def repeats(message: Any) -> int:
    """Return how many images in a row were the very same, 0 where nothing tells it."""
    return _of_first_row(message, 'repeats') or 0


def back(message: Any) -> int:
    """Return how many images ago the very same one came last, 0 if it is new."""
    return _of_first_row(message, 'back') or 0


def _of_first_row(message: Any, name: str) -> int | None:
    field = next((field for field in message.fields if field.name == name), None)
    if field is None or NUMPY_TYPES.get(field.datatype) != 'u4':
        return None
    first = bytes(message.data[field.offset : field.offset + 4])
    number = int.from_bytes(first, 'big' if message.is_bigendian else 'little')
    return number if len(first) == 4 else None


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


def is_of_step(diagnosis: Mapping[str, str]) -> bool:
    """Return whether a diagnosis is of a step of the servo; other nodes publish them, too."""
    return 'phase' in diagnosis and BETWEEN not in diagnosis
