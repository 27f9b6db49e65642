"""What features tell without epipoles: D of eq. (23), their distances, the room that is left."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median_of_sorted
from visual_servo_epipolar.core.geometry.rays import image_points

APART, NEGLIGIBLE = 6.0, 5e-4  # times the median distance of features, plus rad


def feature_difference(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return D = mean(|p_a|^2 - |p_d|^2), shape (...), of features, shape (..., N, 2) (eq. 23)."""
    return np.asarray((_squares(current) - _squares(desired)).mean(axis=-1))


def usual_difference(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return the same without the features that stand apart from where they should be."""
    distance = distances(current, desired)
    median = median_of_sorted(np.sort(distance, axis=-1))
    usual = distance <= APART * median[..., None] + NEGLIGIBLE
    gains = np.where(usual, _squares(current) - _squares(desired), 0.0)
    return np.asarray(gains.sum(axis=-1) / usual.sum(axis=-1))


def difference_deviation(desired: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the deviation of D, shape (...), by ``noise`` of the coordinates of both views."""
    # Of |p_a|^2 - |p_d|^2, on the average of N features.
    return np.asarray(np.sqrt(8.0 * _squares(desired).sum(axis=-1)) * noise / desired.shape[-2])


def distances(current: FloatArray, desired: FloatArray) -> FloatArray:
    """Return by how much points, shape (..., N, 2), differ: shape (..., N)."""
    x, y = current[..., 0] - desired[..., 0], current[..., 1] - desired[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def turned(rays: FloatArray, rotation: FloatArray) -> FloatArray:
    """
    Return image points, (..., N, 2), of ``rays``, (..., N, 3), in a camera turned by ``rotation``.

    ``rotation`` has shape (..., 3, 3). A heading error of 0.1 deg otherwise shifts the zero of D
    by centimetres, unless the features lie evenly to the left and right; a bump of 0.1 deg in the
    floor does so by millimetres.
    """
    return image_points(rays @ rotation.swapaxes(-1, -2))


def room_to_turn(
    current: FloatArray, right: BoolArray, edges: FloatArray, keep: IntArray
) -> FloatArray:
    """
    Return how far cameras may turn left and right until ``keep`` features are left, (B, 2) [rad].

    ``current`` rays have shape (B, N, 2), and ``right``, shape (B, N), says which of them count;
    ``edges``, shape (B, 2), are the bearings of the left and the right edge of the image [rad],
    right positive; ``keep`` has shape (B,).
    """
    counts, rows = right.sum(axis=1), np.arange(len(current))
    keep = np.minimum(keep, counts)
    ordered = np.sort(np.where(right, current[:, :, 0], np.inf), axis=1)
    # A left turn moves features to the right.
    first = np.arctan(ordered[rows, np.maximum(keep, 1) - 1])
    last = np.arctan(ordered[rows, np.maximum(counts - keep, 0)])
    room = np.maximum(np.stack([edges[:, 1] - first, last - edges[:, 0]], axis=1), 0.0)
    room[keep == 0] = 0.0
    return np.asarray(room)


def _squares(points: FloatArray) -> FloatArray:
    x, y = points[..., 0], points[..., 1]
    return np.asarray(x * x + y * y)
