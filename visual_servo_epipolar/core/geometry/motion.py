"""
Motion of the unicycle in the plane of the paper (eq. 4).

The desired pose is (0, 0, pi/2): the goal camera sits at the origin and looks along +y. ``theta``
is measured from +x to the left; the heading *error* shown to people is theta - pi/2. Poses as
arrays, shape (..., 3), are by REP 103: x forward, y left [m], and turn to the left [rad];
``T_a_b`` is the pose of b in a.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray

HALF_PI = math.pi / 2.0


def wrap_angle(angle: float) -> float:
    """Return ``angle`` [rad] wrapped into (-pi, pi]."""
    wrapped = math.remainder(angle, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


@dataclass(frozen=True, slots=True)
class Pose:
    """Pose of the unicycle in the plane of the paper: x, y [m], theta [rad] from +x."""

    x: float
    y: float
    theta: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.theta)):
            raise ValueError(f'a pose must be finite, got {self}; check what produced it')

    @classmethod
    def from_start(cls, x: float, y: float, heading_error_deg: float) -> 'Pose':
        """Build a pose from a start as users give it: x, y [m], heading error [deg]."""
        return cls(float(x), float(y), HALF_PI + math.radians(heading_error_deg))

    @property
    def distance(self) -> float:
        """Distance d from the desired pose [m]."""
        return math.hypot(self.x, self.y)

    @property
    def heading_error(self) -> float:
        """Heading relative to the desired one [rad], left positive."""
        return wrap_angle(self.theta - HALF_PI)


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the unicycle in its own frame: linear [m/s], angular [rad/s] to the left."""

    linear: float
    angular: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.linear) and math.isfinite(self.angular)):
            raise ValueError(
                f'a twist must be finite, got linear {self.linear} and angular {self.angular}; '
                'it is refused and the robot stands still'
            )


DESIRED_POSE = Pose(0.0, 0.0, HALF_PI)
STANDSTILL = Twist(0.0, 0.0)


def integrate(pose: Pose, twist: Twist, dt: float) -> Pose:
    """Move ``pose`` by a constant ``twist`` for ``dt`` [s]: the exact arc of eq. (4)."""
    return Pose(*arc(pose.x, pose.y, pose.theta, twist.linear, twist.angular, dt))


def arc(
    x: float, y: float, theta: float, linear: float, angular: float, dt: float
) -> tuple[float, float, float]:
    """Return x, y, theta after ``dt`` [s]: the chord is v dt sinc(w dt / 2), half-way turned."""
    half = 0.5 * angular * dt
    sinc = math.sin(half) / half if abs(half) > 1e-8 else 1.0 - half * half / 6.0
    chord, middle = linear * dt * sinc, theta + half
    return (
        x + chord * math.cos(middle),
        y + chord * math.sin(middle),
        wrap_angle(theta + angular * dt),
    )


def motion_between(before: Pose, after: Pose) -> tuple[float, float]:
    """Return the arc from one pose to the next: its length [m], backwards negative, and turn."""
    turn = wrap_angle(after.theta - before.theta)
    half = 0.5 * turn
    middle = before.theta + half
    chord = (after.x - before.x) * math.cos(middle) + (after.y - before.y) * math.sin(middle)
    return chord * (half / math.sin(half) if abs(half) > 1e-8 else 1.0), turn


def saturate(twist: Twist, *, max_linear: float, max_angular: float) -> Twist:
    """Scale both velocities by one factor until they obey the limits: slower on the same curve."""
    excess = max(abs(twist.linear) / max_linear, abs(twist.angular) / max_angular, 1.0)
    if excess == 1.0:
        return twist
    return Twist(twist.linear / excess, twist.angular / excess)


def quaternion_from_yaw(yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of a rotation by ``yaw`` [rad] about +z."""
    return 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Return the rotation about +z [rad] of a quaternion that need not be of unit norm."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def compose(T_a_b: FloatArray, T_b_c: FloatArray) -> FloatArray:
    """Return T_a_c."""
    cosine, sine = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y = T_b_c[..., 0], T_b_c[..., 1]
    return np.stack(
        [
            T_a_b[..., 0] + cosine * x - sine * y,
            T_a_b[..., 1] + sine * x + cosine * y,
            T_a_b[..., 2] + T_b_c[..., 2],
        ],
        axis=-1,
    )


def inverse_pose(T_a_b: FloatArray) -> FloatArray:
    """Return T_b_a."""
    cosine, sine = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y = T_a_b[..., 0], T_a_b[..., 1]
    return np.stack([-cosine * x - sine * y, sine * x - cosine * y, -T_a_b[..., 2]], axis=-1)


def relative_pose(T_a_b: FloatArray, T_a_c: FloatArray) -> FloatArray:
    """Return T_b_c, its turn within half a circle."""
    motion = compose(inverse_pose(T_a_b), T_a_c)
    motion[..., 2] = np.remainder(motion[..., 2] + np.pi, 2.0 * np.pi) - np.pi
    return motion
