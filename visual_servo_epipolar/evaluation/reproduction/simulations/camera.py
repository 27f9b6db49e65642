"""Camera of the paper's simulations: images of eight points, and the epipoles from them."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.machinery.eight_point import fundamental_from_matches
from visual_servo_epipolar.core.geometry.cheirality import oriented_bearings
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.geometry.rays import unit_rays

# (X, Y, Z) in the axes of the desired camera: right, down, forward [m]. The paper does not say
# where its points are. These lie ahead of every pose of both simulations and span the view.
POINTS = (
    *((-4.2, -3.1, 8.4), (-2.6, 2.4, 6.3), (-3.3, -0.9, 7.1), (-0.8, 3.6, 9.2)),
    *((-1.1, -3.8, 6.7), (0.9, 1.7, 7.6), (1.6, -3.2, 7.4), (2.3, 2.9, 8.9)),
)
RAY_NOISE = 1e-6  # only scales the cheirality vote: the points are exact


@dataclass(frozen=True, slots=True)
class EpipoleReading:
    """Epipole abscissae e_au and e_du [m], and the sign of cos(psi - theta) by cheirality."""

    e_current: float
    e_desired: float
    sigma: float


class PointCamera:
    """
    A pinhole camera before POINTS: images in metres, as in the paper (k_u = k_v = 1, eq. 2).

    ``focal`` is the true focal length f [m], ``focal_guess`` f_hat [m], by which image points are
    divided to make rays: only sigma depends on it.
    """

    def __init__(self, focal: float, focal_guess: float) -> None:
        self.focal, self.focal_guess = focal, focal_guess
        self.points = np.array(POINTS)
        self.desired = self.image(DESIRED_POSE)

    def image(self, pose: Pose) -> FloatArray:
        """Return the image points from ``pose``, shape (N, 2) [m]; behind the camera nan."""
        alpha = pose.heading_error
        cosine, sine = math.cos(alpha), math.sin(alpha)
        x, z = self.points[:, 0] - pose.x, self.points[:, 2] - pose.y
        right, forward = cosine * x + sine * z, -sine * x + cosine * z
        forward = np.where(forward > 0.0, forward, math.nan)
        return np.asarray(
            np.stack([right, self.points[:, 1]], axis=1) * (self.focal / forward)[:, None]
        )

    def read(self, pose: Pose) -> EpipoleReading:
        """
        Return the epipoles at ``pose``, by the 8-point algorithm (eq. 3).

        DegenerateGeometryError at the goal itself, ValueError where a point is out of view.
        """
        current = self.image(pose) / self.focal_guess
        desired = self.desired / self.focal_guess
        fundamental = fundamental_from_matches(current, desired)
        rays = unit_rays(current), unit_rays(desired)
        bearings = oriented_bearings(fundamental, *rays, noise=RAY_NOISE).bearings
        return EpipoleReading(
            self.focal_guess * bearings.epipole_current,
            self.focal_guess * bearings.epipole_desired,
            bearings.sigma,
        )
