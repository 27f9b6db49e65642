"""What the bundle is given, and what it looks for."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray

VIEW, SHARED = 5, 6  # unknowns of a view: x, y, heading, tilt, roll; and of all, as ``shared``
TILT, ROLL, YAW, SCALE = 0, 1, 2, 5
MOUNT = [3, 4, YAW]  # of the shared unknowns: pose of the camera on the base
FORWARD, LEFT, UP = np.eye(3)


@dataclass(frozen=True, eq=False)
class Problem:
    """
    What is measured of N features in K views, in axes forward, left, up of each camera.

    ``rays``, (N, K, 3), and ``noise``, (N, K) [rad], of the views where ``seen``, (N, K); likewise
    the ``photograph``, (N, 3), and ``photograph_noise``, (N,). ``path``, (K - 1, 3), is the motion
    of the base between views, with the roots of its information ``weights``, (K - 1, 3, 3).
    ``prior`` and ``deviations``, (6,), are of tilt, roll and yaw of the camera [rad], its place
    forward and left [m], and the logarithm of the true way over the path; ``jitter`` [rad].
    """

    rays: FloatArray
    seen: BoolArray
    noise: FloatArray
    photograph: FloatArray
    photograph_noise: FloatArray
    path: FloatArray
    weights: FloatArray
    prior: FloatArray
    deviations: FloatArray
    jitter: float

    @cached_property
    def tangents(self) -> FloatArray:
        """Two directions across each ray of the photograph, (N, 3, 2), as long as its noise."""
        return across(self.photograph).swapaxes(1, 2) * self.photograph_noise[:, None, None]


@dataclass(frozen=True, eq=False)
class Unknowns:
    """
    Values of all unknowns.

    ``views``, (K, 5): pose of the camera in that of the photograph, tilt and roll by the floor;
    ``shared``, (6,), as the prior; ``offsets``, (N, 2), of the photograph's rays in deviations;
    ``nearness``, (N,), inverse depths [1/m].
    """

    views: FloatArray
    shared: FloatArray
    offsets: FloatArray
    nearness: FloatArray

    @property
    def places(self) -> FloatArray:
        """Where the cameras of the views are, (K, 3), on the level of the photograph's."""
        return np.column_stack([self.views[:, :2], np.zeros(len(self.views))])

    @property
    def attitude(self) -> FloatArray:
        """Rotation from axes of the photograph's camera to upright ones, (3, 3)."""
        return attitude(self.shared[TILT], self.shared[ROLL])


def attitude(tilt: float, roll: float) -> FloatArray:
    """Return the rotation from a camera's axes to upright ones, (3, 3): rolled, then tilted."""
    cosine, sine = np.cos(roll), np.sin(roll)
    about_forward = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    return np.asarray(about_left(tilt) @ about_forward)


def about_left(angle: float) -> FloatArray:
    """Return the rotation about the left, (3, 3): forward turns down."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def headings(views: FloatArray) -> FloatArray:
    """Return the rotations from upright cameras of views to that of the photograph, (K, 3, 3)."""
    cosine, sine = np.cos(views[:, 2]), np.sin(views[:, 2])
    turns = np.zeros((len(views), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = cosine
    turns[:, 0, 1], turns[:, 1, 0], turns[:, 2, 2] = -sine, sine, 1.0
    return turns


def across(rays: FloatArray) -> FloatArray:
    """Return two unit vectors across each ray, (..., 3), and across each other: (..., 2, 3)."""
    x, y, z = rays[..., 0], rays[..., 1], rays[..., 2]
    # Duff et al. 2017, Building an orthonormal basis
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes = np.empty((*rays.shape[:-1], 2, 3))
    axes[..., 0, 0], axes[..., 0, 1], axes[..., 0, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    axes[..., 1, 0], axes[..., 1, 1], axes[..., 1, 2] = b, sign + y * y * a, -y
    return axes
