"""Camera rig: which camera a robot carries, and where it is when the robot is at a pose."""

from collections.abc import Sequence
import math
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose, wrap_angle
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME


class CameraPose(NamedTuple):
    """A camera in the world: axes right, down, forward as columns, (3, 3); centre, (3,) [m]."""

    R_world_camera: FloatArray
    centre: FloatArray


def leaned(
    camera: CameraPose, pose: Pose, turn: tuple[float, float, float], rise: float = 0.0
) -> CameraPose:
    """
    Return ``camera`` on a robot at ``pose`` that leans by a ``turn`` about world axes [rad].

    It leans about the middle of its axle, on the floor, which is higher by ``rise`` [m].
    """
    R_leaned = np.asarray(cv2.Rodrigues(np.array(turn))[0])
    foot = np.array([pose.x, pose.y, 0.0])
    centre = foot + R_leaned @ (camera.centre - foot) + (0.0, 0.0, rise)
    return CameraPose(R_leaned @ camera.R_world_camera, centre)


def pitched(camera: CameraPose, pose: Pose, pitch: float) -> CameraPose:
    """Return ``camera`` on a robot at ``pose`` whose body leans ahead by ``pitch`` [rad]."""
    sin, cos = math.sin(pose.theta), math.cos(pose.theta)
    return leaned(camera, pose, (-pitch * sin, pitch * cos, 0.0))


class SimulatedRig(Protocol):
    """What holds the camera on the robot; all that it does follows from pose and frame."""

    @property
    def camera(self) -> CameraModel:
        """The true camera model."""

    @property
    def views(self) -> Sequence['SimulatedRig']:
        """The rig as joints may turn it, closely enough that nothing is seen in between alone."""

    def turned(self, joints: Joints) -> 'SimulatedRig':
        """Return the rig with the joints of its head at these angles; at rest they are zero."""

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        """
        Return where the camera is with the robot at ``pose`` in ``frame``: -1, 0, 1, ...

        Frame -1 is that of the photograph, with joints at rest; None is a level floor, which
        shakes nothing.
        """


class TrueGeometry(NamedTuple):
    """
    Bearings of the other camera's centre [rad], right positive, and the baseline on the floor [m].

    They are those of upright cameras at the true centres, which look where the true ones look:
    offset and yaw of the mount count, tilt and roll do not.
    """

    current: float
    desired: float
    baseline: float

    def error(self, current: float, desired: float) -> float:
        """Return the larger error of two measured bearings [rad]; nan if either is."""
        if not (math.isfinite(current) and math.isfinite(desired)):
            return math.nan
        errors = wrap_angle(current - self.current), wrap_angle(desired - self.desired)
        return max(map(abs, errors))


def true_geometry(rig: SimulatedRig, pose: Pose, frame: int | None = None) -> TrueGeometry:
    """Return the geometry of the view from ``pose`` in ``frame`` and of the photograph."""
    (x, y), heading = _upright(rig, pose, frame)
    (goal_x, goal_y), goal_heading = _upright(rig, DESIRED_POSE, DESIRED_FRAME)
    ahead = math.atan2(goal_y - y, goal_x - x)
    return TrueGeometry(
        current=wrap_angle(heading - ahead),
        desired=wrap_angle(goal_heading - ahead - math.pi),
        baseline=math.hypot(goal_x - x, goal_y - y),
    )


def _upright(
    rig: SimulatedRig, pose: Pose, frame: int | None
) -> tuple[tuple[float, float], float]:
    """Return place [m] and heading [rad] of the upright camera that looks as the true one does."""
    axes, centre = rig.camera_pose(pose, frame)
    return (float(centre[0]), float(centre[1])), math.atan2(axes[1, 2], axes[0, 2])
