"""A camera mounted anywhere on a base: exact kinematics, and what a drive shows it."""

from collections.abc import Iterator
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.twoview.measurement import Measurement

NOISE = 1e-3  # of a bearing [rad]
PERIOD = 0.1  # between two images [s]
START = Pose.from_start(0.8, -3.0, 5.0)
# Turns in place to both sides, then a bend to and fro: speeds [m/s, rad/s] and how long [s].
DRIVE = [
    (Twist(0.0, 0.4), 1.0),
    (Twist(0.0, -0.4), 2.0),
    (Twist(0.0, 0.4), 1.0),
    (Twist(0.3, 0.15), 3.0),
    (Twist(0.3, -0.2), 3.0),
    (Twist(-0.3, 0.15), 3.0),
    (Twist(0.0, 0.4), 1.0),
    (Twist(0.0, -0.4), 1.0),
]


def rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y


def camera_pose(base: Pose, mount: FloatArray) -> Pose:
    """Return the camera of ``base``, in axes of the camera of a base that stands at the goal."""
    yaw, *lever = mount.tolist()
    x, y = rotated(*lever, base.theta)
    goal_x, goal_y = rotated(*lever, math.pi / 2.0)
    return Pose(*rotated(base.x + x - goal_x, base.y + y - goal_y, -yaw), base.theta)


def of_camera_axes(mount: FloatArray) -> FloatArray:
    """Return ``mount`` with its lever arm, which is given in axes of the base, in the camera's."""
    yaw, *lever = mount.tolist()
    return np.array([yaw, *rotated(*lever, -yaw)])


def sight(bearings: Bearings, *, deviation: float = NOISE) -> Measurement:
    return Measurement(
        0,
        40,
        769.0,
        0.3,
        bearings=bearings,
        deviation=deviation,
        heading_error=bearings.heading_error,
    )


def frames(
    mount: FloatArray, *, start: Pose = START, seed: int = 0
) -> Iterator[tuple[Measurement, float, float]]:
    """Yield of each image of DRIVE what is measured, the travel before, the true distance."""
    rng = np.random.default_rng(seed)
    base, travel = start, 0.0
    twists = [twist for twist, duration in DRIVE for _ in range(round(duration / PERIOD))]
    for twist in [*twists, Twist(0.0, 0.0)]:
        camera = camera_pose(base, mount)
        true = Bearings.from_pose(camera)
        noise, turn = (NOISE * rng.standard_normal(2)).tolist()
        bearings = Bearings(true.psi + noise, true.phi + noise + 0.3 * turn)
        yield sight(bearings), travel, camera.distance
        base, travel = integrate(base, twist, PERIOD), twist.linear * PERIOD
