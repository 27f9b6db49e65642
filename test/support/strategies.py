"""What hypothesis draws: poses, twists, bearings; and the scene that two views share."""

import math

from hypothesis import reject
from hypothesis import strategies as st
import numpy as np

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import (
    Bearings,
    fundamental_from_bearings,
    in_pixels,
)
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.geometry.rays import image_points, normalised, unit_rays

CAMERA = Camera(1280, 1024, 769.0, 769.0, 635.0, 512.0)
MIN_DEPTH, MAX_SLOPE = 0.5, 2.0  # a scene point is this far ahead [m], this far off axis (63 deg)


def floats(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


def angles() -> st.SearchStrategy[float]:
    return floats(-math.pi, math.pi)


def poses(*, min_baseline: float = 0.05, reach: float = 5.0) -> st.SearchStrategy[Pose]:
    """Poses anywhere around the goal, at any heading."""
    anywhere = st.builds(Pose, floats(-reach, reach), floats(-reach, reach), angles())
    return anywhere.filter(lambda pose: pose.distance >= min_baseline)


def regular_poses() -> st.SearchStrategy[Pose]:
    """Poses with both epipoles at a finite place, at most 84 deg off the axis."""

    def regular(pose: Pose) -> bool:
        bearings = Bearings.from_pose(pose)
        return abs(math.cos(bearings.phi)) > 0.1 and abs(math.sin(bearings.psi)) > 0.1

    return poses(min_baseline=0.3).filter(regular)


def poses_behind_the_goal() -> st.SearchStrategy[Pose]:
    """Starts of the region `front`: behind the goal, looking at the scene."""
    return st.builds(Pose.from_start, floats(-1.5, 1.5), floats(-5.0, -2.0), floats(-15.0, 15.0))


def pose_with(
    e_current: float, e_desired: float, *, sigma: float, distance: float, ahead: bool = False
) -> Pose:
    """Return the pose with these epipoles at unit focal length, behind the goal or ahead of it."""
    side = 1.0 if ahead else -1.0
    psi = math.atan2(side, side * e_desired)
    phi = math.atan2(-sigma * e_current, sigma)
    return Pose(distance * math.cos(psi), distance * math.sin(psi), psi - phi)


def twists() -> st.SearchStrategy[Twist]:
    return st.builds(Twist, floats(-2.0, 2.0), floats(-3.0, 3.0))


def bearings() -> st.SearchStrategy[Bearings]:
    return st.builds(Bearings, angles(), angles())


def seen_from(pose: Pose, points: np.ndarray) -> np.ndarray:
    """Return ``points``, shape (N, 3) in camera axes of the goal, in those of ``pose``."""
    alpha = pose.heading_error
    right = np.array([math.cos(alpha), 0.0, math.sin(alpha)])
    forward = np.array([-math.sin(alpha), 0.0, math.cos(alpha)])
    moved = points - [pose.x, 0.0, pose.y]
    return np.column_stack([moved @ right, moved[:, 1], moved @ forward])


def fundamental_from_pose(matrix: np.ndarray, pose: Pose) -> np.ndarray:
    """Return F of the view from ``pose`` and of the desired view in pixels (eq. 3)."""
    return in_pixels(fundamental_from_bearings(Bearings.from_pose(pose)), matrix, matrix)


def room() -> np.ndarray:
    """Return points all around, shape (N, 3), in camera axes of the goal; never on one plane."""
    return (np.random.default_rng(7).random((4000, 3)) - 0.5) * [24.0, 6.0, 24.0]


def matches(pose: Pose, *, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Return exact unit rays, current and desired, of points in front of both cameras."""
    current, desired = matched_points(pose, count=count)
    return unit_rays(current), unit_rays(desired)


def panorama(pose: Pose, *, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Return exact unit rays, current and desired, of points all round, most not in front."""
    points = room()
    current = seen_from(pose, points)
    near = np.minimum(np.linalg.norm(current, axis=1), np.linalg.norm(points, axis=1))
    good = np.flatnonzero(near > MIN_DEPTH)[:count]
    return normalised(current[good]), normalised(points[good])


def through_lens(rays: np.ndarray, scale: float, shift: float = 0.0) -> np.ndarray:
    """Return unit ``rays`` as a pinhole with another focal length and centre would tell them."""
    return unit_rays(scale * image_points(rays) + [shift, 0.0])


def random_rays(rng: np.random.Generator, count: int, size: float = 1.0) -> np.ndarray:
    """Return unit rays to points spread evenly over a square of the image plane."""
    return unit_rays(size * (rng.random((count, 2)) - 0.5))


def blurred(rays: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Return unit ``rays`` turned at random by ``noise`` [rad] along two axes."""
    return normalised(rays + noise * rng.standard_normal(rays.shape))


def matched_points(pose: Pose, *, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Return exact image-plane points, current and desired, of points in front of both cameras."""
    points = room()
    current = seen_from(pose, points)
    good = np.ones(len(points), dtype=bool)
    for view in (current, points):
        depth = view[:, 2]
        good &= (depth > MIN_DEPTH) & (np.abs(view[:, :2]).max(axis=1) < MAX_SLOPE * depth)
    if good.sum() < count:
        reject()
    current, points = current[good][:count], points[good][:count]
    return current[:, :2] / current[:, 2:], points[:, :2] / points[:, 2:]


def assert_same_matrix(one: np.ndarray, other: np.ndarray, tolerance: float) -> None:
    """Compare matrices of no scale and no sign."""
    one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
    assert min(np.abs(one - other).max(), np.abs(one + other).max()) <= tolerance
