"""
What the planar estimators share: the epipolar constraint of a planar motion, and robust scores.

With p = (cos psi, sin psi), q = (cos phi, sin phi) and rays (u, v) of an upright camera,

    r = v_a (p0 - p1 u_d) + v_d (q0 u_a + q1) = 0

is p_d^T F p_a = 0 for the F of a planar motion. Only v carries information: features on the
horizon say nothing. The residual over its gradient is the Sampson distance, and both are linear or
quadratic in h = (p0, p1, q0, q1), so that all hypotheses are scored by matrix products.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray

INLIER_DEVIATIONS = 2.5  # where the truncated score levels off
TUKEY = 4.685  # 95 % efficient for Gaussian noise


class Rays(NamedTuple):
    """Coordinates of the matches at unit focal length, each of shape (..., N)."""

    u_a: FloatArray
    v_a: FloatArray
    u_d: FloatArray
    v_d: FloatArray


def rays_of(current: FloatArray, desired: FloatArray) -> Rays:
    """Return the columns of ``current`` and ``desired``, shape (..., N, 2) each."""
    return Rays(current[..., 0], current[..., 1], desired[..., 0], desired[..., 1])


class Forms(NamedTuple):
    """The matches as rows for matrix products: h @ linear, and quadratic(h) @ quadratic."""

    linear: FloatArray  # (4, N): residual
    quadratic: FloatArray  # (6, N): squared gradient
    sides_a: FloatArray  # (2, N): p0 - p1 u_d
    sides_d: FloatArray  # (2, N): q0 u_a + q1


def forms(rays: Rays) -> Forms:
    """Return the linear and quadratic forms of the matches."""
    u_a, v_a, u_d, v_d = rays
    one = np.ones_like(u_a)
    return Forms(
        np.stack([v_a, -v_a * u_d, v_d * u_a, v_d]),
        np.stack([one, -2.0 * u_d, u_d**2 + v_a**2, u_a**2 + v_d**2, 2.0 * u_a, one]),
        np.stack([one, -u_d]),
        np.stack([u_a, one]),
    )


def squared_distances(hypotheses: FloatArray, rows: Forms) -> FloatArray:
    """Return the squared Sampson distance of each match from each h, shape (H, N)."""
    p0, p1, q0, q1 = hypotheses.T
    quadratic = np.stack([p0 * p0, p0 * p1, p1 * p1, q0 * q0, q0 * q1, q1 * q1], axis=1)
    residual = hypotheses @ rows.linear
    residual *= residual
    residual /= quadratic @ rows.quadratic + 1e-12
    return np.asarray(residual)


def scores(hypotheses: FloatArray, rows: Forms, threshold: float) -> FloatArray:
    """
    Return the truncated squared distance summed over the matches, shape (H,) (MSAC).

    A match whose two sides have the same sign lies behind one camera, whatever its distance: the
    oriented epipolar constraint, which in planar motion says that v_a and v_d have the same sign.
    """
    limit = threshold * threshold
    squared = squared_distances(hypotheses, rows)
    np.minimum(squared, limit, out=squared)
    sides = (hypotheses[:, :2] @ rows.sides_a) * (hypotheses[:, 2:] @ rows.sides_d)
    squared[sides > 0.0] = limit
    return np.asarray(squared.sum(axis=1))


def pairs(count: int, limit: int) -> tuple[IntArray, IntArray]:
    """
    Return at most ``limit`` different pairs of 0 .. count - 1, every match as often as any other.

    All pairs where they are few; else those at the distances 1, 2, 3, ... around a circle, which
    needs no chance.
    """
    if count * (count - 1) // 2 <= limit:
        first, second = np.triu_indices(count, 1)
        return first.astype(np.int64), second.astype(np.int64)
    turns = limit // count + 1
    steps = np.unique(np.linspace(1, (count - 1) // 2, turns).astype(np.int64))
    first = np.tile(np.arange(count), len(steps))
    second = (first + np.repeat(steps, count)) % count
    return first[:limit], second[:limit]


def two_point_hypotheses(rays: Rays, limit: int) -> FloatArray:
    """
    Return both solutions of each pair of matches, shape (2 P, 4), with |p| = |q| = 1.

    A p = -B q for the two rows, hence p = M q and q^T (M^T M - I) q = 0, a quadratic in tan phi
    whose roots are written with the double angle. Where noise leaves no real root, the nearest
    double one is taken.
    """
    first, second = pairs(rays.u_a.shape[-1], limit)
    u_a, v_a, u_d, v_d = (coordinate[first] for coordinate in rays)
    U_a, V_a, U_d, V_d = (coordinate[second] for coordinate in rays)
    determinant = v_a * V_a * (u_d - U_d)
    with np.errstate(divide='ignore', invalid='ignore'):
        # M = -A^-1 B, A = [[v_a, -v_a u_d], [V_a, -V_a U_d]], B = [[v_d u_a, v_d], ...].
        low, high = v_d * V_a, V_d * v_a
        m00 = (low * U_d * u_a - high * u_d * U_a) / determinant
        m01 = (low * U_d - high * u_d) / determinant
        m10 = (low * u_a - high * U_a) / determinant
        m11 = (low - high) / determinant
        s00, s11 = m00 * m00 + m10 * m10 - 1.0, m01 * m01 + m11 * m11 - 1.0
        s01 = m00 * m01 + m10 * m11
        mean, difference = 0.5 * (s00 + s11), 0.5 * (s00 - s11)
        turn = np.arccos(np.clip(-mean / np.hypot(difference, s01), -1.0, 1.0))
        double = np.arctan2(s01, difference)
        phi = 0.5 * np.concatenate([double + turn, double - turn])
        q0, q1 = np.cos(phi), np.sin(phi)
        p0 = np.tile(m00, 2) * q0 + np.tile(m01, 2) * q1
        p1 = np.tile(m10, 2) * q0 + np.tile(m11, 2) * q1
        norm = np.hypot(p0, p1)
        found = np.stack([p0 / norm, p1 / norm, q0, q1], axis=1)
    return np.asarray(found[np.isfinite(found).all(axis=1)])


def diverse(hypotheses: FloatArray, costs: FloatArray, count: int, *, spread: float) -> FloatArray:
    """Return the best ``count`` hypotheses that differ by ``spread`` [rad] in psi or phi."""
    order = np.argsort(costs)[: 40 * count]
    ranked = hypotheses[order]
    psi = np.arctan2(ranked[:, 1], ranked[:, 0])
    phi = np.arctan2(ranked[:, 3], ranked[:, 2])
    chosen: list[int] = []
    free = np.ones(len(order), bool)
    while free.any() and len(chosen) < count:
        best = int(np.argmax(free))
        chosen.append(best)
        # h and -h are the same geometry.
        apart = np.maximum(np.abs(np.sin(psi - psi[best])), np.abs(np.sin(phi - phi[best])))
        free &= apart > np.sin(spread)
    return np.asarray(ranked[chosen])


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Sampson distances and their derivatives: shape (K, N), and (K, N) for psi, phi each."""

    distance: FloatArray
    by_psi: FloatArray
    by_phi: FloatArray
    gradient: FloatArray  # norm of the gradient, (K, N)
    side_a: FloatArray  # p0 - p1 u_d, (K, N)
    side_d: FloatArray  # q0 u_a + q1, (K, N)


def linearise(psi: FloatArray, phi: FloatArray, rays: Rays) -> Linearised:
    """Linearise the Sampson distance at ``psi``, ``phi``, shape (K, 1) each."""
    u_a, v_a, u_d, v_d = rays
    p0, p1, q0, q1 = np.cos(psi), np.sin(psi), np.cos(phi), np.sin(phi)
    side_a, side_d = p0 - p1 * u_d, q0 * u_a + q1
    side_a_psi, side_d_phi = -p1 - p0 * u_d, q0 - q1 * u_a
    residual = v_a * side_a + v_d * side_d
    q0_v, p1_v = q0 * v_d, p1 * v_a
    gradient = np.sqrt(side_a**2 + side_d**2 + q0_v**2 + p1_v**2) + 1e-12
    distance = residual / gradient
    pull = distance / gradient
    by_psi = (v_a * side_a_psi - pull * (side_a * side_a_psi + p1_v * p0 * v_a)) / gradient
    by_phi = (v_d * side_d_phi - pull * (side_d * side_d_phi - q0_v * q1 * v_d)) / gradient
    return Linearised(distance, by_psi, by_phi, gradient, side_a, side_d)


def tukey(distance: FloatArray, deviation: float) -> FloatArray:
    """Return Tukey's weights for residuals of ``deviation``."""
    ratio = np.minimum((distance / (TUKEY * deviation)) ** 2, 1.0)
    return np.asarray((1.0 - ratio) ** 2)
