"""
Epipolar geometry of two views of a camera that moves in the plane (section II and eqs. 3, 5, 6).

Two views are called ``current`` (the paper's *actual*) and ``desired``, in that order. The
baseline is written in **oriented bearings**: psi = atan2(y, x) is the direction from the desired
to the current camera centre, phi = psi - theta the same seen from the current heading. Cosine and
sine of the two never jump when an epipole passes through infinity, as abscissae do.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, ROUNDING, TINY
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose, wrap_angle
from visual_servo_epipolar.core.geometry.rays import dot, homogeneous

MIN_MATCHES = 8  # that define a geometry by linear equations
MOTION_PARAMETERS = 5  # of a motion without its scale: a fit needs as many matches
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Bearings:
    """Directions of the baseline: psi in the plane, phi = psi - theta from the heading [rad]."""

    psi: float
    phi: float

    @classmethod
    def from_pose(cls, pose: Pose) -> 'Bearings':
        """Return the bearings of ``pose``; DegenerateGeometryError where x = y = 0."""
        if pose.distance == 0.0:
            raise DegenerateGeometryError(
                'epipoles need a baseline, got a pose at the goal; only the rotation is defined'
            )
        psi = math.atan2(pose.y, pose.x)
        return cls(psi, wrap_angle(psi - pose.theta))

    @property
    def epipole_current(self) -> float:
        """Abscissa e_au at unit focal length, tan(theta - psi) (eq. 6)."""
        return -math.tan(self.phi)

    @property
    def epipole_desired(self) -> float:
        """Abscissa e_du at unit focal length, x / y (eq. 5)."""
        # Never infinite, as -tan(phi) is never: laws multiply it by what goes to zero.
        return math.cos(self.psi) / (math.sin(self.psi) or TINY)

    @property
    def alpha(self) -> float:
        """Bearing atan(e_au / f) of the current epipole, in [-pi/2, pi/2] [rad]."""
        return math.atan(self.epipole_current)

    @property
    def chi(self) -> float:
        """Bearing atan(e_du / f) of the desired epipole, in [-pi/2, pi/2] [rad]."""
        return math.atan(self.epipole_desired)

    @property
    def sigma(self) -> float:
        """Sign of cos(psi - theta): -1 while the goal camera lies ahead of the robot."""
        return math.copysign(1.0, math.cos(self.phi))

    @property
    def current(self) -> float:
        """Bearing of the goal camera's centre in the current view [rad], right positive."""
        return math.atan2(math.sin(self.phi), -math.cos(self.phi))

    @property
    def desired(self) -> float:
        """Bearing of the current camera's centre in the desired view [rad], right positive."""
        return math.atan2(math.cos(self.psi), math.sin(self.psi))

    @property
    def heading_error(self) -> float:
        """Heading of the current against the desired view, theta - pi/2 [rad]."""
        return wrap_angle(self.psi - self.phi - HALF_PI)

    def reversed(self) -> 'Bearings':
        """Return the same baseline with the other sign: what cheirality decides between."""
        return Bearings(wrap_angle(self.psi + math.pi), wrap_angle(self.phi + math.pi))


def cross_matrix(vectors: FloatArray) -> FloatArray:
    """Return [v]x of vectors, shape (..., 3), such that [v]x w = v x w: (..., 3, 3)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 0, 1], matrices[..., 0, 2], matrices[..., 1, 2] = -z, y, -x
    matrices[..., 1, 0], matrices[..., 2, 0], matrices[..., 2, 1] = z, -y, x
    return matrices


def rotation_desired_current(heading_error: float) -> FloatArray:
    """Return R, shape (3, 3), that turns current into desired camera axes [rad, left positive]."""
    cosine, sine = math.cos(heading_error), math.sin(heading_error)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])


def fundamental_from_bearings(bearings: Bearings) -> FloatArray:
    """Return F of a planar motion at unit focal length, shape (3, 3), Frobenius norm sqrt(2)."""
    cos_psi, sin_psi = math.cos(bearings.psi), math.sin(bearings.psi)
    cos_phi, sin_phi = math.cos(bearings.phi), math.sin(bearings.phi)
    return np.array([[0.0, -sin_psi, 0.0], [cos_phi, 0.0, sin_phi], [0.0, cos_psi, 0.0]])


def in_pixels(
    fundamental: FloatArray, current_matrix: FloatArray, desired_matrix: FloatArray
) -> FloatArray:
    """Return K_d^-T F K_a^-1: a matrix for rays turned into one for pixels."""
    return np.asarray(
        np.linalg.inv(desired_matrix).T @ fundamental @ np.linalg.inv(current_matrix)
    )


def epipoles(fundamental: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return the epipoles of the current and of the desired image.

    Parameters
    ----------
    fundamental : array, shape (3, 3)
        F such that p_desired^T F p_current = 0 (eq. 3).

    Returns
    -------
    current, desired : arrays, shape (3,)
        F e_a = 0 and F^T e_d = 0: homogeneous, unit norm, sign free; may lie at infinity.

    Raises DegenerateGeometryError if F is not of rank 2, so that an epipole is not a point.

    """
    u, singular, vt = np.linalg.svd(fundamental)
    if not singular[1] > ROUNDING * singular[0]:
        raise DegenerateGeometryError(
            f'fundamental matrix must have rank 2, got singular values {singular}; '
            'move away from the desired pose or skip this pair'
        )
    return vt[2], u[:, 2]


def sampson_distance(
    fundamental: FloatArray,
    current: FloatArray,
    desired: FloatArray,
    noise: FloatArray | float = 1.0,
) -> FloatArray:
    """
    Return the first-order distance of each match from F, shape (..., N).

    Parameters
    ----------
    fundamental : array, shape (..., 3, 3)
        F with p_desired^T F p_current = 0.
    current, desired : arrays, shape (..., N, 3) or (..., N, 2)
        Unit rays, which may point anywhere, behind the camera, too: distances are angles [rad]. Or
        points of the image plane, in whose unit distances are.
    noise : float or array, shape (..., N, 2)
        Deviations of current and desired points, or of the angles of rays [rad]: distances are
        then in deviations. With those of one pixel they are in pixels.

    """
    are_points = current.shape[-1] == 2
    if are_points:
        current, desired = homogeneous(current), homogeneous(desired)
    # Hartley and Zisserman, eq. 11.9, with gradients in the tangent planes of both rays.
    normal_desired = current @ np.swapaxes(fundamental, -1, -2)  # F p_a
    normal_current = desired @ fundamental  # F^T p_d
    residual = dot(normal_desired, desired)
    square = residual * residual

    def across(normal: FloatArray) -> FloatArray:
        if are_points:
            return np.asarray(normal[..., 0] * normal[..., 0] + normal[..., 1] * normal[..., 1])
        return np.maximum(dot(normal, normal) - square, 0.0)

    variance = np.square(noise if np.ndim(noise) else np.full(2, noise))
    gradient = across(normal_current) * variance[..., 0]
    gradient += across(normal_desired) * variance[..., 1]
    return np.asarray(residual / np.sqrt(np.maximum(gradient, 1e-300)))


def constraint_rows(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return rows a with a . vec(F) = p_d^T F p_a, (..., 9), F by rows; rays or points."""
    if current.shape[-1] == 2:
        current, desired = homogeneous(current), homogeneous(desired)
    rows = desired[..., :, None] * current[..., None, :]
    return np.asarray(rows.reshape(*desired.shape[:-1], 9))


def rank_two(fundamental: FloatArray) -> FloatArray:
    """Return the closest matrices of rank 2 in Frobenius norm, shape (..., 3, 3)."""
    u, singular, vt = np.linalg.svd(fundamental)
    return np.asarray((u[..., :2] * singular[..., None, :2]) @ vt[..., :2, :])


def decomposed(essential: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit baselines, (K, 3), and both rotations, (2, K, 3, 3), of E, shape (K, 3, 3)."""
    u, _, vt = np.linalg.svd(essential)
    u[..., 2] *= np.sign(np.linalg.det(u))[:, None]
    vt[..., 2, :] *= np.sign(np.linalg.det(vt))[:, None]
    return u[..., 2], np.stack([u @ QUARTER_TURN @ vt, u @ QUARTER_TURN.T @ vt])
