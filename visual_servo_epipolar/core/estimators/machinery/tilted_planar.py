"""
Planar motion seen by a camera that is not quite upright: E and its derivatives by six parameters.

E = C_d^T F C_a with C = R_x(tilt) R_z(roll) from camera to level axes. The derivatives by tilt put
the generator S_x beside F, those by roll put S_z beside E; both are linear.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import ComplexArray, FloatArray
from visual_servo_epipolar.core.estimators.machinery.hypotheses import FAMILIES

PSI, PHI, TILT, TILT_JUMP, ROLL, ROLL_JUMP = range(6)  # jump: current less desired view

# psi, phi, tilt and roll of the desired camera, tilt and roll of the current one
TO_CAMERAS = np.zeros((6, 6))
TO_CAMERAS[[PSI, PHI, TILT, ROLL], [0, 1, 2, 3]] = 1.0
TO_CAMERAS[[TILT, TILT_JUMP], 4] = TO_CAMERAS[[ROLL, ROLL_JUMP], 5] = 1.0

S_X = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
S_Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def _inner() -> FloatArray:
    """Return what turns (p0, p1, q0, q1) into F and its derivatives but those by roll, (4, 45)."""
    families = FAMILIES.reshape(4, 3, 3, 3)
    plain = families[:, 0]
    jump = plain @ S_X
    both = jump - S_X @ plain
    parts = np.concatenate([families, both[:, None], jump[:, None]], axis=1)
    return np.asarray(parts.reshape(4, 45))


def _rolls() -> FloatArray:
    """Return what turns E into its derivatives by roll and roll jump, shape (9, 18)."""
    plain = np.eye(9).reshape(9, 3, 3)
    jump = plain @ S_Z
    return np.stack([jump - S_Z @ plain, jump], axis=1).reshape(9, 18)


def _products() -> FloatArray:
    """Return what turns (ct, st, 1) times (cr, sr, 1) into R_x(tilt) R_z(roll), shape (9, 9)."""
    products = np.zeros((3, 3, 3, 3))
    products[2, 0, 0, 0] = products[0, 1, 1, 0] = products[0, 0, 1, 1] = products[1, 2, 1, 2] = 1.0
    products[2, 1, 0, 1] = products[1, 1, 2, 0] = products[1, 0, 2, 1] = -1.0
    products[0, 2, 2, 2] = 1.0
    return products.reshape(9, 9)


INNER, ROLLS, PRODUCTS = _inner(), _rolls(), _products()


def matrices(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by ``parameters``, shape (..., 6), as rows: (..., 7, 9)."""
    *leading, _ = parameters.shape
    phasors = phasors_of(parameters)
    inner = (phasors.view(np.float64)[..., :4] @ INNER).reshape(*leading, 5, 3, 3)
    both = cameras(phasors)
    desired, current = both[..., :1, :, :], both[..., 1:, :, :]
    rows = np.empty((*leading, 7, 9))
    plain = rows.reshape(*leading, 7, 3, 3)[..., :5, :, :]
    np.matmul(desired.swapaxes(-2, -1) @ inner, current, out=plain)
    rows[..., 5:, :] = (rows[..., 0, :] @ ROLLS).reshape(*leading, 2, 9)
    return rows


def phasors_of(parameters: FloatArray) -> ComplexArray:
    """Return exp(i angle) in the order of TO_CAMERAS, shape (..., 6)."""
    return np.asarray(np.exp(1j * (parameters @ TO_CAMERAS)))


def cameras(phasors: ComplexArray) -> FloatArray:
    """
    Return R_x(tilt) R_z(roll) of the desired and of the current camera, shape (..., 2, 3, 3).

    ``phasors``, shape (..., 6), are exp(i angle) in the order of TO_CAMERAS.
    """
    *leading, _ = phasors.shape
    factors = np.ones((*leading, 2, 2, 3))
    factors[..., :2] = phasors[..., 2:].view(np.float64).reshape(*leading, 2, 2, 2)
    products = factors[..., 0, :, None] * factors[..., 1, None, :]
    return np.asarray((products.reshape(*leading, 2, 9) @ PRODUCTS).reshape(*leading, 2, 3, 3))
