"""
Matches as rays; planar motions by two of them, their scores, and tests of modes.

With the phasors P = exp(i psi), Q = exp(i phi) and rays (x, y, z) of an upright camera,
p_d^T F p_a = 0 for the F of a planar motion reads

    r = Re(P alpha + Q beta) = 0,    alpha = y_a (z_d + i x_d),    beta = y_d (x_a - i z_a).

Only y carries information: features on the horizon carry none. Above the horizon of one camera is
above that of the other (the oriented epipolar constraint), which names some outliers beforehand.
The residual is linear in (P, Q) and its squared gradient in (P^2, Q^2), so that all hypotheses are
scored by two matrix products. Functions of rays take leading axes: one geometry each.
"""

from functools import lru_cache
import math
from typing import Any, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import ComplexArray, FloatArray, frozen, IntArray, TINY
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.twoview.estimator import Prior

INLIER_DEVIATIONS = 2.5  # where the truncated score levels off
WORST = INLIER_DEVIATIONS**2  # cost of a match that does not agree
SEPARATION = 0.07  # bearings that differ by less are one geometry [rad]
ALTERNATIVE_COST = 3.0 * WORST  # what three matches may add by chance
MARGIN = 0.25  # of the mean truncated cost: modes worse by more cannot win


class Rays(NamedTuple):
    """
    Unit rays of the matches, current and desired, by components, each of shape (..., N).

    ``noise_a`` and ``noise_d`` are the deviations of their angles [rad].
    """

    x_a: FloatArray
    y_a: FloatArray
    z_a: FloatArray
    x_d: FloatArray
    y_d: FloatArray
    z_d: FloatArray
    noise_a: FloatArray
    noise_d: FloatArray

    def take(self, rows: Any) -> 'Rays':
        """Return the matches, or the pairs of views, chosen by index or mask."""
        return Rays(*(part[rows] for part in self))

    @property
    def current(self) -> FloatArray:
        """The current rays, shape (..., N, 3)."""
        return np.stack(self[:3], axis=-1)

    @property
    def desired(self) -> FloatArray:
        """The desired rays, shape (..., N, 3)."""
        return np.stack(self[3:6], axis=-1)

    @property
    def matches(self) -> int:
        """Number of matches N."""
        return int(self.x_a.shape[-1])

    @property
    def noise(self) -> FloatArray:
        """Deviation of the angles of each match, shape (..., N)."""
        return np.sqrt(0.5 * (self.noise_a * self.noise_a + self.noise_d * self.noise_d))

    @property
    def mean_noise(self) -> FloatArray:
        """Deviation of the angles of an average match, shape (...)."""
        return np.asarray(self.noise.mean(axis=-1))

    def blurred(self, deviation: float) -> 'Rays':
        """Return the rays with a second source of noise [rad]."""
        return self._replace(
            noise_a=np.hypot(self.noise_a, deviation), noise_d=np.hypot(self.noise_d, deviation)
        )


def rays_of(current: FloatArray, desired: FloatArray, noise: FloatArray | float) -> Rays:
    """
    Return the components of unit rays, shape (..., N, 3), and their noise.

    ``noise`` has shape (..., N, 2), of current and desired rays, or (...): one number a pair.
    """
    noise = np.asarray(noise)
    parts = np.empty((8, *current.shape[:-1]))
    for axis in range(3):
        parts[axis], parts[3 + axis] = current[..., axis], desired[..., axis]
    if noise.ndim < current.ndim:
        parts[6:] = noise[..., None]
    else:
        parts[6], parts[7] = noise[..., 0], noise[..., 1]
    return Rays(*parts)


@lru_cache(maxsize=256)
def pairs(count: int, limit: int) -> tuple[IntArray, IntArray]:
    """
    Return at most ``limit`` different pairs of 0 .. count - 1, every match as often as any other.

    All pairs where they are few; else those at the distances 1, 2, 3, ... around a circle, which
    needs no chance.
    """
    if count * (count - 1) // 2 <= limit:
        first, second = np.triu_indices(count, 1)
        return frozen(first.astype(np.int64)), frozen(second.astype(np.int64))
    turns = limit // count + 1
    steps = np.linspace(1, (count - 1) // 2, turns).astype(np.int64)
    steps = steps[np.diff(steps, prepend=0) > 0]  # each once: they ascend
    first = np.tile(np.arange(count), len(steps))
    second = (first + np.repeat(steps, count)) % count
    return frozen(first[:limit]), frozen(second[:limit])


def two_point_hypotheses(rays: Rays, limit: int) -> ComplexArray:
    """
    Return P and Q of both solutions of at most ``limit`` pairs of matches, shape (..., 2, H).

    Two residuals give 2 D P = i (A Q + B conj(Q)) with D real; |P| = 1 then fixes the real part of
    A conj(B) Q^2, which leaves two angles. Where noise leaves none, the nearest one is taken; a
    pair that says nothing gives any hypothesis.
    """
    first, second = pairs(rays.matches, limit)
    alpha = rays.y_a * (rays.z_d - 1j * rays.x_d)  # the conjugate
    beta = rays.y_d * (rays.x_a - 1j * rays.z_a)
    alpha_1, alpha_2 = alpha[..., first], alpha[..., second]
    beta_1, beta_2 = beta[..., first], beta[..., second]
    a = beta_1 * alpha_2 - beta_2 * alpha_1
    b = beta_1.conj() * alpha_2 - beta_2.conj() * alpha_1
    twice_d = 2.0 * (alpha_1.conj() * alpha_2).imag
    axis = a.conj() * b + TINY
    size = np.abs(axis)
    cosine = twice_d**2 - (a.real**2 + a.imag**2 + b.real**2 + b.imag**2)
    cosine /= 2.0 * size
    np.minimum(np.maximum(cosine, -1.0, out=cosine), 1.0, out=cosine)
    # Q^2 = exp(+-i angle) axis / |axis|, by half the angle.
    middle = np.sqrt(axis / size)
    along, across = middle * np.sqrt(0.5 + 0.5 * cosine), middle * np.sqrt(0.5 - 0.5 * cosine)
    q = np.stack([along + 1j * across, along - 1j * across])
    p = 1j * (a * q + b * q.conj()) + TINY
    p *= np.copysign(1.0, twice_d) / np.abs(p)
    both = np.stack([p, q], axis=-2)
    return np.concatenate([both[0], both[1]], axis=-1)


def scores(hypotheses: ComplexArray, rays: Rays) -> FloatArray:
    """
    Return the mean truncated squared Sampson distance of the matches, shape (..., H) (MSAC).

    ``hypotheses`` has shape (..., 2, H), ``rays`` (..., N); the cost runs from 0 to 1.
    """
    x_a, y_a, z_a, x_d, y_d, z_d, noise_a, noise_d = rays
    linear = np.stack([y_a * z_d, -y_a * x_d, y_d * x_a, y_d * z_a], axis=-1)
    linear /= (INLIER_DEVIATIONS * noise_d)[..., None]
    # |F p_a|^2 = y_a^2 + (q0 x_a + q1 z_a)^2 and |F^T p_d|^2 = y_d^2 + (p0 z_d - p1 x_d)^2 by
    # double angles: cos^2 psi = (1 + cos 2 psi) / 2 and so on. What is along the ray itself is r.
    ratio = noise_a / noise_d
    ratio = ratio * ratio
    half_a, half_d = 0.5 * (x_a * x_a + z_a * z_a), 0.5 * ratio * (x_d * x_d + z_d * z_d)
    double = np.stack(
        [ratio * z_d * z_d - half_d, -ratio * x_d * z_d, x_a * x_a - half_a, x_a * z_a], axis=-1
    )
    squared = linear @ _parts(hypotheses)
    gradient = double @ _parts(hypotheses * hypotheses)
    gradient += (y_a * y_a + half_a + ratio * (y_d * y_d) + half_d)[..., None]
    squared *= squared
    squared /= np.maximum(gradient, TINY)
    np.clip(squared, 0.0, 1.0, out=squared)  # faster than minimum
    return np.asarray(squared.sum(axis=-2) / rays.matches)


def _parts(phasors: ComplexArray) -> FloatArray:
    """Return real and imaginary parts as rows: (..., 2, H) complex to (..., 4, H)."""
    *leading, count = phasors.shape
    parts = np.empty((*leading, 2, count))
    parts[..., 0, :], parts[..., 1, :] = phasors.real, phasors.imag
    return parts.reshape(*leading[:-1], 4, count)


def best_modes(
    angles: FloatArray,
    costs: FloatArray,
    count: int,
    *,
    separation: float = SEPARATION,
    margin: float = MARGIN,
) -> IntArray:
    """
    Return the places of the best ``count`` (psi, phi), shape (K, 2), that are different modes.

    Those nearer than ``separation`` [rad] are one mode; those with costs beyond the least one and
    ``margin`` are left out.
    """
    near = np.flatnonzero(costs <= costs.min() + margin)
    remaining = near[costs[near].argsort()]
    chosen: list[np.int64] = []
    while len(remaining) and len(chosen) < count:
        chosen.append(remaining[0])
        # Both reversed are the same geometry: the sine of the angle between them counts.
        sines = np.abs(np.sin(angles[remaining] - angles[remaining[0]])).max(axis=1)
        remaining = remaining[sines > math.sin(separation)]
    return np.array(chosen)


def choose_mode(
    angles: FloatArray, costs: FloatArray, prior: Prior
) -> tuple[int, Bearings | None]:
    """
    Return the index of the best mode, and an alternative that the data alone do not rule out.

    ``angles`` (psi, phi) has shape (K, 2); ``costs``, shape (K,), are in squared deviations. The
    last bearings of ``prior`` count, the alternative does not depend on them.
    """
    total = costs
    if prior.bearings is not None:
        leap = (np.sin(angles - prior.angles) ** 2).sum(axis=1) / prior.deviation**2
        total = costs + np.minimum(leap, 2.0 * len(costs) + 40.0)
    best = int(total.argmin())
    sines = np.abs(np.sin(angles - angles[best])).max(axis=1)
    close = costs < costs[best] + ALTERNATIVE_COST
    others = np.flatnonzero(close & (sines > np.sin(SEPARATION)))
    if not len(others):
        return best, None
    psi, phi = angles[others[costs[others].argmin()]]
    return best, Bearings(float(psi), float(phi))
