"""Dead reckoning: velocity and uncertainty as wheel odometry reports them."""

from dataclasses import dataclass, field
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import (
    motion_between,
    Pose,
    STANDSTILL,
    Twist,
    wrap_angle,
)
from visual_servo_epipolar.core.stamps import NANOSECONDS


@dataclass(frozen=True, slots=True, eq=False)
class DeadReckoning:
    """
    Wheel odometry at one time: pose, mean velocity since the time before, and their covariances.

    ``pose_covariance``, (3, 3), is that of x, y [m] and theta [rad] in the frame of the odometry,
    zero at the start; ``twist_covariance``, (2, 2), that of linear [m/s] and angular [rad/s].
    """

    pose: Pose
    now_ns: int
    twist: Twist = STANDSTILL
    pose_covariance: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    twist_covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))

    def advanced(self, pose: Pose, now_ns: int, *, noise: float) -> 'DeadReckoning':
        """
        Return the odometry at ``now_ns``, when the wheels say ``pose``; before that, ``self``.

        ``noise`` is the deviation of the way after a metre, and of the heading after a metre and
        after a radian: both are random walks. Unequal wheels and slip are not in it, for the
        wheels do not know of them.
        """
        dt = (now_ns - self.now_ns) / NANOSECONDS
        if dt <= 0.0:
            return self
        way, turn = motion_between(self.pose, pose)
        variances = noise**2 * np.array([abs(way), abs(way) + abs(turn)])
        return DeadReckoning(
            pose,
            now_ns,
            Twist(way / dt, turn / dt),
            _propagated(self.pose_covariance, self.pose, pose, variances),
            np.diag(variances / dt**2),
        )


def world_to_odometry(truth: Pose, odometry: Pose) -> Pose:
    """Return the pose of the odometry's frame in the world: where the wheels think they began."""
    turn = truth.theta - odometry.theta
    sin, cos = math.sin(turn), math.cos(turn)
    return Pose(
        truth.x - cos * odometry.x + sin * odometry.y,
        truth.y - sin * odometry.x - cos * odometry.y,
        wrap_angle(turn),
    )


def _propagated(
    covariance: FloatArray, before: Pose, after: Pose, variances: FloatArray
) -> FloatArray:
    """Return the covariance of ``after``: that of ``before`` carried along, and the step's own."""
    dx, dy = after.x - before.x, after.y - before.y
    middle = before.theta + 0.5 * wrap_angle(after.theta - before.theta)
    carried = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    # The way errs along the step; the heading errs half-way, with the other half as its lever.
    step = np.array([[math.cos(middle), -0.5 * dy], [math.sin(middle), 0.5 * dx], [0.0, 1.0]])
    grown = carried @ covariance @ carried.T + step @ np.diag(variances) @ step.T
    return np.asarray(0.5 * (grown + grown.T))
