"""
Angular Sampson distances of many epipolar geometries at once, and their derivatives.

Matrices come by rows, E and its derivatives by P parameters, shape (..., 1 + P, 9). The residual
p_d^T E p_a of unit rays and its gradient in the planes that touch the unit sphere are linear in E,
so that one product with a table of the matches gives them all, whatever the parameters mean.

The noise of a ray is assumed equal along all directions across it, with a deviation of its own
(see ``Camera.resolution``). The noise of a pixel is not quite that: off the axis of a pinhole its
angle is less along the radius, by the cosine. Knowing it exactly gained nothing in 800 pairs over
79 deg of view (0.242 / 0.77 deg both ways), and every caller would have to pass two vectors a ray.
Where it matters, at a focal length many times too short, ``image_axes`` has the exact ones.
"""

from collections.abc import Callable

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.machinery.hypotheses import (
    INLIER_DEVIATIONS,
    Rays,
    TINY,
)
from visual_servo_epipolar.core.geometry.rays import Axes, tangents


def table_of(
    rays: Rays, plausible: BoolArray | None = None, axes: Callable[..., Axes] = tangents
) -> FloatArray:
    """
    Return the matches as columns for products with matrices, shape (9, 5 N).

    The five are the residual p_d^T E p_a in deviations of the desired ray, two components of E p_a
    across the desired ray, and two of E^T p_d across the current ray, these times the ratio of the
    deviations. ``axes`` are those along which noise moves a ray. A match that is not
    ``plausible``, (N,), is a column of zeros: it costs and pulls nothing.
    """
    x, y, z = np.array([[rays.x_a, rays.x_d], [rays.y_a, rays.y_d], [rays.z_a, rays.z_d]])
    ratio = rays.noise_a / rays.noise_d
    # A column is the product of the desired ray, or an axis across it, and of the current one.
    desired, current = np.empty((2, 3, 5, rays.matches))
    for row, (ray, *across) in enumerate(zip((x, y, z), *axes(x, y, z), strict=True)):
        desired[row, 0] = ray[1] / rays.noise_d
        desired[row, 1], desired[row, 2] = across[0][1], across[1][1]
        desired[row, 3:] = ray[1] * ratio
        current[row, :3] = ray[0]
        current[row, 3], current[row, 4] = across[0][0], across[1][0]
    if plausible is not None and not plausible.all():
        desired *= plausible
    return np.asarray((desired[:, None] * current[None]).reshape(9, -1))


def squared_distances(matrices: FloatArray, table: FloatArray) -> FloatArray:
    """Return the squared Sampson distances from E by rows, shape (K, 9), of one table: (K, N)."""
    values = (matrices @ table).reshape(len(matrices), 5, -1)
    squares = values * values
    return np.asarray(squares[:, 0] / (squares[:, 1:].sum(axis=1) + TINY))


def truncated_costs(matrices: FloatArray, table: FloatArray) -> FloatArray:
    """Return the mean truncated squared distances from E by rows, shape (K, 9): 0 to 1, (K,)."""
    squared = squared_distances(matrices, table) / INLIER_DEVIATIONS**2
    return np.asarray(np.minimum(squared, 1.0).mean(axis=1))


def linearised(stack: FloatArray, table: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return residuals r and g times the derivatives of r / g, (..., 1 + P, N), and g^2, (..., N).

    g is the norm of the gradient of r, so that r / g is the Sampson distance. ``stack`` has shape
    (..., 1 + P, 9).
    """
    values = (stack.reshape(-1, 9) @ table).reshape(*stack.shape[:-1], 5, -1)
    lines = values[..., 1:, :]
    # g^2, and half its derivatives
    slopes = np.einsum('...ln,...pln->...pn', lines[..., 0, :, :], lines)
    squared_gradient = slopes[..., 0, :] + 1e-12
    slopes *= (values[..., 0, 0, :] / squared_gradient)[..., None, :]
    slopes[..., 0, :] = 0.0
    return np.subtract(values[..., 0, :], slopes, out=slopes), squared_gradient
