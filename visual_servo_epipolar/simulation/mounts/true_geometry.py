"""True geometry: where the cameras of two views really are and look, to judge what is measured."""

import math
from typing import NamedTuple

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose, wrap_angle
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME
from visual_servo_epipolar.simulation.mounts.simulated_rig import SimulatedRig


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
