"""
Sampson distances of many epipolar geometries at once, and their derivatives.

Matrices come by rows, E and its derivatives by P parameters, shape (K, 1 + P, 9). Residual and
gradient of p_d^T E p_a are linear in E: products with a table of the matches give them all,
whatever the parameters mean.
"""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.estimators.planar import Rays, TINY


class Table(NamedTuple):
    """
    The matches as columns for products with matrices, shape (..., 9, N) and (..., 3, N) twice.

    ``products`` p_d p_a^T give the residual p_d^T E p_a in deviations of the noise; ``current``
    p_a and ``desired`` p_d give the lines E p_a and E^T p_d.
    """

    products: FloatArray
    current: FloatArray
    desired: FloatArray

    def take(self, rows: BoolArray) -> 'Table':
        """Return the geometries chosen by a mask."""
        return Table(*(part[rows] for part in self))


def table_of(rays: Rays, noise: FloatArray | float, kept: BoolArray | None = None) -> Table:
    """
    Return the table of ``rays``, shape (..., N), with ``noise`` of shape (...,).

    A match that is not ``kept`` is a column of zeros: it costs and pulls nothing, and the number
    of columns stays the same for all geometries of a stack.
    """
    *leading, count = rays.u_a.shape
    p_a, p_d = np.ones((2, *leading, 3, count))
    p_a[..., 0, :], p_a[..., 1, :], p_d[..., 0, :], p_d[..., 1, :] = rays
    if kept is not None:
        p_a *= kept[..., None, :]
        p_d *= kept[..., None, :]
    scaled = p_d / np.asarray(noise)[..., None, None]
    products = scaled[..., :, None, :] * p_a[..., None, :, :]
    return Table(products.reshape(*leading, 9, count), p_a, p_d)


def squared_distances(matrices: FloatArray, table: Table) -> FloatArray:
    """Return the squared Sampson distances from E by rows, shape (K, 9): (K, N)."""
    solid = matrices.reshape(-1, 3, 3)
    residual = matrices @ table.products
    lines = solid[:, :2].reshape(-1, 3) @ table.current
    others = solid.swapaxes(1, 2)[:, :2].reshape(-1, 3) @ table.desired
    squares = (lines * lines + others * others).reshape(len(matrices), 2, -1)
    return np.asarray(residual * residual / (squares.sum(axis=1) + TINY))


def linearised(stack: FloatArray, table: Table) -> tuple[FloatArray, FloatArray]:
    """
    Return residuals r and g times the derivatives of r / g, (K, 1 + P, N), and g^2, (K, N).

    g is the norm of the gradient of r, so that r / g is the Sampson distance.
    """
    count, size, _ = stack.shape
    solid = stack.reshape(count, size, 3, 3)
    residual = stack @ table.products
    # The first two components of E p_a and of E^T p_d, by parameter.
    rows, columns = solid[:, :, :2], solid.swapaxes(2, 3)[:, :, :2]
    products = _with_first(rows.reshape(count, -1, 3) @ table.current)
    products += _with_first(columns.reshape(count, -1, 3) @ table.desired)
    squared_gradient = products[:, 0] + 1e-12
    products *= (residual[:, 0] / squared_gradient)[:, None]
    products[:, 0] = 0.0
    residual -= products
    return residual, squared_gradient


def _with_first(lines: FloatArray) -> FloatArray:
    """Return the scalar products of vectors, (K, 2 P, N), with the first: (K, P, N)."""
    pairs = lines.reshape(len(lines), -1, 2, lines.shape[-1])
    return np.asarray(np.einsum('kln,kpln->kpn', pairs[:, 0], pairs))
