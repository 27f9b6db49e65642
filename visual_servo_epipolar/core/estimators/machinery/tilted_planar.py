"""
Planar motion seen by a camera that is not quite upright: E and its derivatives by six parameters.

E = C_d^T F C_a with C = R_x(tilt) R_z(roll) from camera to level axes. The derivatives by tilt put
the generator S_x beside F, those by roll put S_z beside E; both are linear.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import ComplexArray, FloatArray
from visual_servo_epipolar.core.estimators.machinery.hypotheses import FAMILIES

PSI, PHI, TILT, TILT_JUMP, ROLL, ROLL_JUMP = range(6)

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
    made = np.zeros((3, 3, 3, 3))
    made[2, 0, 0, 0] = made[0, 1, 1, 0] = made[0, 0, 1, 1] = made[1, 2, 1, 2] = 1.0
    made[2, 1, 0, 1] = made[1, 1, 2, 0] = made[1, 0, 2, 1] = -1.0
    made[0, 2, 2, 2] = 1.0
    return made.reshape(9, 9)


INNER, ROLLS, PRODUCTS = _inner(), _rolls(), _products()


def matrices(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by ``parameters``, shape (K, 6), as rows: (K, 7, 9)."""
    count = len(parameters)
    numbers = np.exp(1j * (parameters @ TO_CAMERAS))
    inner = (numbers.view(np.float64)[:, :4] @ INNER).reshape(count, 5, 3, 3)
    both, made = cameras(numbers), np.empty((count, 7, 9))
    solid = made.reshape(count, 7, 3, 3)
    np.matmul(both[:, :1].swapaxes(2, 3) @ inner, both[:, 1:], out=solid[:, :5])
    made[:, 5:] = (made[:, 0] @ ROLLS).reshape(count, 2, 9)
    return made


def cameras(numbers: ComplexArray) -> FloatArray:
    """
    Return R_x(tilt) R_z(roll) of the desired and of the current camera, shape (K, 2, 3, 3).

    ``numbers``, shape (K, 6), are exp(i angle) in the order of TO_CAMERAS.
    """
    factors = np.ones((len(numbers), 2, 2, 3))
    factors[..., :2] = numbers[:, 2:].view(np.float64).reshape(-1, 2, 2, 2)
    products = factors[:, :, 0, :, None] * factors[:, :, 1, None]
    return np.asarray((products.reshape(-1, 2, 9) @ PRODUCTS).reshape(-1, 2, 3, 3))
