"""
Essential matrices from five matches each, of cameras that may be turned any way.

Stewenius, Engels, Nister 2006, *Recent developments on direct relative orientation*: E is a
combination of the four matrices that five matches leave, and the ten cubic equations that make it
essential are an eigenvalue problem. All samples are solved side by side, and any direction is a
ray, behind the camera, too.
"""

from functools import lru_cache
from itertools import combinations_with_replacement, permutations

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, frozen, IntArray, TINY
from visual_servo_epipolar.core.geometry.epipolar import constraint_rows
from visual_servo_epipolar.core.geometry.least_squares import LARGEST_CONDITION, samples
from visual_servo_epipolar.core.twoview.hypotheses import Rays

SAMPLE = 5
REAL = 1e-7  # imaginary part of an eigenvalue that counts as real
LARGEST = 1e12  # element of an action matrix whose eigenvalues mean anything

# Monomials of degree three in x, y, z, w as sorted triples of 0 .. 3: those without w first, which
# are eliminated; then w times the ten of degree two, which are the basis of the quotient ring.
CUBIC = list(combinations_with_replacement(range(3), 3))
QUADRATIC = list(combinations_with_replacement(range(4), 2))
MONOMIALS = CUBIC + [(*pair, 3) for pair in QUADRATIC]


def _gather() -> FloatArray:
    """Return what adds up the coefficients of equal monomials, shape (64, 20)."""
    gather = np.zeros((4, 4, 4, 20))
    for column, monomial in enumerate(MONOMIALS):
        for factors in set(permutations(monomial)):
            gather[(*factors, column)] = 1.0
    return gather.reshape(64, 20)


def _times_x() -> tuple[IntArray, IntArray]:
    """Return to which monomial x takes each of the basis, as places in MONOMIALS."""
    order = [list(monomial) for monomial in MONOMIALS]
    places = np.array([order.index(sorted((0, *pair))) for pair in QUADRATIC])
    return np.flatnonzero(places < 10), places


GATHER = _gather()
REDUCED, TIMES_X = _times_x()
LEFT_OVER = np.delete(np.arange(10), REDUCED)
X_W, Y_W, Z_W, W_W = (QUADRATIC.index((k, 3)) for k in range(4))


@lru_cache(maxsize=64)
def samples_of_five(count: int, limit: int) -> IntArray:
    """Return ``limit`` samples of five different matches among ``count``, the same each time."""
    return frozen(samples(np.random.default_rng((count, SAMPLE)), limit, count, SAMPLE))


def essential_matrices(rays: Rays, chosen: IntArray) -> FloatArray:
    """
    Return E, shape (K, 3, 3), of unit norm, with p_d^T E p_a = 0 for a sample of five matches.

    ``rays`` are of shape (N,), ``chosen``, shape (S, 5), are the samples; each gives up to ten.
    """
    current = np.stack([rays.x_a, rays.y_a, rays.z_a], axis=-1)[chosen]
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d], axis=-1)[chosen]
    whole, _ = np.linalg.qr(constraint_rows(current, desired).swapaxes(-1, -2), mode='complete')
    null = whole[..., SAMPLE:].swapaxes(-1, -2).reshape(-1, 4, 3, 3)
    null, action = _action_matrices(null)
    values, vectors = np.linalg.eig(action)
    sample, root = np.nonzero(_real(values) & (np.abs(vectors[..., W_W, :]) > 1e-12))
    solution = vectors[sample, :, root].real
    weights = solution[:, [X_W, Y_W, Z_W, W_W]]
    essential = np.einsum('ka,kaij->kij', weights, null[sample])
    norm = np.sqrt((essential * essential).sum(axis=(-2, -1)))
    return np.asarray(essential / (norm + TINY)[:, None, None])


def _real(values: FloatArray) -> BoolArray:
    return np.asarray(np.abs(values.imag) <= REAL * (1.0 + np.abs(values.real)))


def _action_matrices(null: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the bases, (S, 4, 3, 3), with regular equations, and the action of x on them."""
    equations = _cubic_equations(null)
    regular = np.abs(np.linalg.det(equations[..., :10])) > 1e-200
    null, equations = null[regular], equations[regular]
    try:
        reduced = np.linalg.solve(equations[..., :10], equations[..., 10:])
    except np.linalg.LinAlgError:  # a last pivot that is noise for one and zero for the other
        regular = np.linalg.cond(equations[..., :10]) < LARGEST_CONDITION
        null, equations = null[regular], equations[regular]
        reduced = np.linalg.solve(equations[..., :10], equations[..., 10:])
    finite = np.abs(reduced).max(axis=(-2, -1)) < LARGEST  # nor is nan
    null, reduced = null[finite], reduced[finite]
    action = np.zeros((len(null), 10, 10))
    action[:, REDUCED] = -reduced[:, TIMES_X[REDUCED]]
    action[:, LEFT_OVER, TIMES_X[LEFT_OVER] - 10] = 1.0
    return null, action


def _cubic_equations(null: FloatArray) -> FloatArray:
    """Return det E = 0 and 2 E E^T E - tr(E E^T) E = 0 by monomials, shape (S, 10, 20)."""
    products = null[:, :, None] @ null[:, None].swapaxes(-1, -2)  # E_a E_b^T
    trace = products.trace(axis1=-2, axis2=-1)
    cubic = 2.0 * products[:, :, :, None] @ null[:, None, None]
    cubic -= trace[..., None, None, None] * null[:, None, None]
    crosses = np.cross(null[:, :, None, 1], null[:, None, :, 2])
    determinant = np.einsum('sai,sbci->sabc', null[:, :, 0], crosses)
    columns = np.concatenate([determinant.reshape(-1, 64, 1), cubic.reshape(-1, 64, 9)], axis=-1)
    return np.asarray(columns.swapaxes(-1, -2) @ GATHER)
