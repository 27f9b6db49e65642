"""
Planar motion seen by a camera that is not quite upright: E and its derivatives by six parameters.

E = C_d^T F C_a with C = R_x(tilt) R_z(roll) from camera to level axes. The derivatives by tilt put
the generator S_x beside F, those by roll put S_z beside E; both are linear.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import ComplexArray, FloatArray
from visual_servo_epipolar.core.estimators.planar_2dof import FAMILIES

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


INNER, ROLLS = _inner(), _rolls()


def matrices(parameters: FloatArray) -> FloatArray:
    """Return E and its derivatives by ``parameters``, shape (K, 6), as rows: (K, 7, 9)."""
    count = len(parameters)
    numbers = np.exp(1j * (parameters @ TO_CAMERAS))
    inner = (numbers.view(np.float64)[:, :4] @ INNER).reshape(count, 5, 3, 3)
    both = cameras(numbers[:, 2::2], numbers[:, 3::2])
    made = np.swapaxes(both[:, :1], 2, 3) @ inner @ both[:, 1:]
    made = made.reshape(count, 5, 9)
    return np.concatenate([made, (made[:, 0] @ ROLLS).reshape(count, 2, 9)], axis=1)


def cameras(tilt: ComplexArray, roll: ComplexArray) -> FloatArray:
    """Return R_x(tilt) R_z(roll) of exp(i tilt), exp(i roll), shape (..., 3, 3)."""
    made = np.zeros((*tilt.shape, 3, 3))
    made[..., 0, 0], made[..., 0, 1] = roll.real, -roll.imag
    made[..., 1, 0], made[..., 1, 1] = tilt.real * roll.imag, tilt.real * roll.real
    made[..., 2, 0], made[..., 2, 1] = -tilt.imag * roll.imag, -tilt.imag * roll.real
    made[..., 1, 2], made[..., 2, 2] = tilt.imag, tilt.real
    return made
