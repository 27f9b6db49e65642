"""One epipolar geometry of matches in pixels of which any may be wrong."""

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.tracking.alignment.warps import squared_lengths

EPIPOLAR_PX = 2.0  # largest distance of an inlier from its epipolar line
AGREEMENT_PX = 1.0  # less: a fit by least squares bends towards an outlier
MIN_MATCHES = 8
CONFIDENCE = 0.999
ITERATIONS = 5000


def epipolar_inliers(current: FloatArray, desired: FloatArray) -> BoolArray:
    """
    Return the inliers of one robust epipolar geometry, shape (N,).

    ``current`` and ``desired`` are the pixels of N matches, shape (N, 2) each; none of fewer than
    eight is an inlier.
    """
    return epipolar_geometry(current, desired)[1]


def agree_on_one_geometry(current: FloatArray, desired: FloatArray) -> bool:
    """
    Return whether least squares find a geometry that all matches fit within AGREEMENT_PX.

    ``current`` and ``desired`` are their pixels, shape (N, 2) each, N at least eight. In most
    frames they do, and a robust search, which takes several times as long, has nothing to drop.
    """
    columns, rows, scale = _normalised(current, desired)
    products = (rows[:, :, None] * columns[:, None, :]).reshape(-1, 9)
    moments = products.T @ products
    if not np.isfinite(moments).all():
        return False
    fundamental = np.linalg.eigh(moments)[1][:, 0].reshape(3, 3)
    across_current, across_desired = columns @ fundamental.T, rows @ fundamental
    x, y, one = (across_current * rows).T
    residual = x + y + one
    gradient = squared_lengths(across_current[:, :2]) + squared_lengths(across_desired[:, :2])
    return bool((residual**2 <= (scale * AGREEMENT_PX) ** 2 * gradient).all())


def _normalised(current: FloatArray, desired: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return both as rows (x, y, 1) about their means, with the one scale that makes them one."""
    rows = np.ones((2, len(current), 3))
    pixels = rows[:, :, :2]
    pixels[0], pixels[1] = current, desired
    pixels -= pixels.mean(axis=1, keepdims=True)
    spread = float(np.sqrt((pixels * pixels).mean()))
    scale = 1.0 / spread if spread > 0.0 else 1.0
    pixels *= scale
    return rows[0], rows[1], scale


def epipolar_geometry(
    current: FloatArray, desired: FloatArray
) -> tuple[FloatArray | None, BoolArray]:
    """
    Return one robust fundamental matrix, (3, 3), and which matches fit it, shape (N,).

    ``current`` and ``desired`` are their pixels, shape (N, 2) each. No matrix, and no inlier, of
    fewer than eight finite matches, or where none is found.
    """
    if len(current) < MIN_MATCHES or not np.isfinite([current, desired]).all():
        return None, np.zeros(len(current), bool)
    geometry, inliers = _robust_geometry(current, desired)
    # Where nothing has moved every sample is degenerate, and OpenCV 4.6 finds no geometry at all.
    still = np.hypot(*(current - desired).T) <= EPIPOLAR_PX
    if still.sum() >= MIN_MATCHES and still.sum() > inliers.sum():
        # Any epipole does; with one in the middle, lines are those of driving ahead.
        return cross_matrix(np.append(desired[still].mean(axis=0), 1.0)), np.asarray(still)
    return geometry, inliers


def _robust_geometry(
    current: FloatArray, desired: FloatArray
) -> tuple[FloatArray | None, BoolArray]:
    none = None, np.zeros(len(current), bool)
    try:
        fundamental, mask = cv2.findFundamentalMat(
            current, desired, cv2.USAC_MAGSAC, EPIPOLAR_PX, CONFIDENCE, ITERATIONS
        )
    except cv2.error:  # OpenCV 5 asserts that there is a model, where few matches gave none
        return none
    if fundamental is None or mask is None or fundamental.shape != (3, 3):
        return none
    return np.asarray(fundamental), np.asarray(mask.ravel() > 0)
