"""Coordinate frames as markers, for viewers where nobody publishes /tf."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from geometry_msgs.msg import Point
import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.messages import write

AXIS_M, LINE_M, LETTER_M = 0.3, 0.02, 0.1
COLOURS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # x, y, z by REP 103


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
