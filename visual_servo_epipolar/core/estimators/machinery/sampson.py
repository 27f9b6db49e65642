"""
Sampson distances of many epipolar geometries at once, and their derivatives.

Matrices come by rows, E and its derivatives by P parameters, shape (K, 1 + P, 9). Residual and
gradient of p_d^T E p_a are linear in E, so that one product with a table of the matches gives them
all, whatever the parameters mean.
"""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays, TINY


def table_of(
    rays: Rays, noise: FloatArray | float, plausible: BoolArray | None = None
) -> FloatArray:
    """
    Return the matches as columns for products with matrices, shape (..., 9, 5 N).

    The five are the residual p_d^T E p_a in deviations of ``noise``, shape (...,), two components
    of E p_a, and two of E^T p_d. A match that is not ``plausible``, (..., N), is a column of
    zeros: it costs and pulls nothing, and all geometries of a stack have as many columns.
    """
    *leading, count = rays.u_a.shape
    p_a, p_d = np.ones((2, *leading, 3, count))
    p_a[..., 0, :], p_a[..., 1, :], p_d[..., 0, :], p_d[..., 1, :] = rays
    if plausible is not None and not plausible.all():
        p_a *= plausible[..., None, :]
        p_d *= plausible[..., None, :]
    scaled = p_d / np.asarray(noise)[..., None, None]
    table = np.zeros((*leading, 3, 3, 5, count))
    np.multiply(scaled[..., :, None, :], p_a[..., None, :, :], out=table[..., 0, :])
    table[..., 0, :, 1, :] = table[..., 1, :, 2, :] = p_a
    table[..., :, 0, 3, :] = table[..., :, 1, 4, :] = p_d
    return table.reshape(*leading, 9, 5 * count)


def squared_distances(matrices: FloatArray, table: FloatArray) -> FloatArray:
    """Return the squared Sampson distances from E by rows, shape (K, 9), of one table: (K, N)."""
    values = (matrices @ table).reshape(len(matrices), 5, -1)
    squares = values * values
    return np.asarray(squares[:, 0] / (squares[:, 1:].sum(axis=1) + TINY))


def linearised(stack: FloatArray, table: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return residuals r and g times the derivatives of r / g, (..., 1 + P, N), and g^2, (..., N).

    g is the norm of the gradient of r, so that r / g is the Sampson distance. ``stack`` has shape
    (..., 1 + P, 9); ``table`` is that of one geometry, or has the leading axes of ``stack``.
    """
    # The blocks of a product depend on its size: a stack of geometries is never one product.
    products = stack.reshape(-1, 9) @ table if table.ndim == 2 else stack @ table
    values = products.reshape(*stack.shape[:-1], 5, -1)
    lines = values[..., 1:, :]
    # g^2, and half its derivatives
    slopes = np.einsum('...ln,...pln->...pn', lines[..., 0, :, :], lines)
    squared_gradient = slopes[..., 0, :] + 1e-12
    slopes *= (values[..., 0, 0, :] / squared_gradient)[..., None, :]
    slopes[..., 0, :] = 0.0
    return np.subtract(values[..., 0, :], slopes, out=slopes), squared_gradient
