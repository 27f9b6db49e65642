"""What features tell without epipoles: D of eq. (23), distances, margins of the view."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median_of_sorted

APART, NEGLIGIBLE = 6.0, 5e-4  # times the median distance of features, plus rad


def feature_difference(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return D = mean(|p_a|^2 - |p_d|^2), shape (...), of features, shape (..., N, 2) (eq. 23)."""
    return np.asarray((_squares(current) - _squares(desired)).mean(axis=-1))


def usual_difference(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return D of the features, (..., N, 2), that are about as far off as most, shape (...)."""
    distance = distances(current, desired)
    median = median_of_sorted(np.sort(distance, axis=-1))
    usual = distance <= APART * median[..., None] + NEGLIGIBLE
    squares = np.where(usual, _squares(current) - _squares(desired), 0.0)
    return np.asarray(squares.sum(axis=-1) / usual.sum(axis=-1))


def difference_deviation(desired: FloatArray, noise: FloatArray | float) -> FloatArray:
    """Return the deviation of D, (...), by ``noise``, (...), of coordinates of both views."""
    # Of |p_a|^2 - |p_d|^2, on the average of N features.
    return np.asarray(np.sqrt(8.0 * _squares(desired).sum(axis=-1)) * noise / desired.shape[-2])


def distances(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return by how much points, shape (..., N, 2), differ: shape (..., N)."""
    x, y = current[..., 0] - desired[..., 0], current[..., 1] - desired[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def turned(rays: FloatArray, rotation: FloatArray) -> FloatArray:
    """
    Return ``rays``, shape (..., N, 2), as a camera sees them that is turned by ``rotation``.

    ``rotation`` has shape (..., 3, 3). A heading error of 0.1 deg otherwise shifts the zero of D
    by centimetres, unless the features lie evenly to the left and right; a bump of 0.1 deg in the
    floor does so by millimetres.
    """
    vectors = rays @ rotation[..., :2].swapaxes(-1, -2) + rotation[..., None, :, 2]
    return np.asarray(vectors[..., :2] / vectors[..., 2:])


def view_margins(
    current: FloatArray, counted: BoolArray, edges: FloatArray, keep: IntArray | int
) -> tuple[FloatArray, FloatArray]:
    """
    Return how far a camera may turn left and right until ``keep`` features remain [rad].

    ``current`` rays have shape (..., N, 2), and ``counted``, shape (..., N), says which of them
    count; ``edges``, shape (..., 2), are the bearings of the left and the right edge of the image
    [rad], right positive; ``keep`` and both results have shape (...).
    """
    counts = counted.sum(axis=-1)
    keep = np.minimum(keep, counts)
    ordered = np.sort(np.where(counted, current[..., 0], np.inf), axis=-1)
    # A left turn moves features to the right.
    first = np.arctan(_taken(ordered, np.maximum(keep, 1) - 1))
    last = np.arctan(_taken(ordered, np.maximum(counts - keep, 0)))
    some = keep > 0
    left = np.where(some, np.maximum(edges[..., 1] - first, 0.0), 0.0)
    right = np.where(some, np.maximum(last - edges[..., 0], 0.0), 0.0)
    return left, right


def _taken(values: FloatArray, place: IntArray) -> FloatArray:
    """Return the element at ``place``, shape (...), of ``values``, shape (..., N)."""
    return np.asarray(np.take_along_axis(values, np.asarray(place)[..., None], axis=-1)[..., 0])


def _squares(points: FloatArray) -> FloatArray:
    x, y = points[..., 0], points[..., 1]
    return np.asarray(x * x + y * y)
