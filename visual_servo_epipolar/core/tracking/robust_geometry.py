"""
One epipolar geometry of matches of which any may be wrong: in pixels, or as unit rays all around.

Of rays hypotheses are of two kinds: of three matches, as if the motion were planar and the camera
level, and of eight, as if it were any. The best are refined on all that fit them, as any motion.
"""

import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.epipolar import (
    constraint_rows,
    cross_matrix,
    MIN_MATCHES,
    rank_two,
    sampson_distance,
)
from visual_servo_epipolar.core.geometry.least_squares import (
    cauchy,
    null_vector,
    REWEIGHTINGS,
    samples,
)
from visual_servo_epipolar.core.geometry.rays import image_points, LEAST_FORWARD

EPIPOLAR_PX = 2.0  # largest distance of an inlier from its epipolar line
CONFIDENCE = 0.999
ITERATIONS = 5000
SAMPLES = 500  # of rays, of either kind
LEVEL = 4.0  # a hypothesis of a level camera is judged by so many limits: it is tilted a little
BEST = 6  # hypotheses that are refined
# Elements of E, by rows, that a planar motion of a level camera leaves (y is the vertical).
PLANAR = np.array([1, 3, 5, 7])


def epipolar_geometry(
    current: FloatArray, desired: FloatArray, pixel: float = 1.0
) -> tuple[FloatArray | None, BoolArray]:
    """
    Return one robust G with p_d^T G p_a = 0, (3, 3), and which matches fit it, shape (N,).

    ``current`` and ``desired`` are pixels, (N, 2), and G is F, or unit rays, (N, 3), a ``pixel``
    [rad] wide at the centre, and it is E. No matrix, and no inlier, of fewer than eight finite
    matches, or where none is found.
    """
    if len(current) < MIN_MATCHES or not np.isfinite([current, desired]).all():
        return None, np.zeros(len(current), bool)
    if current.shape[1] == 3:
        return _essential(current, desired, pixel)
    geometry, inliers = _robust_geometry(current, desired)
    # Where nothing has moved every sample is degenerate, and OpenCV 4.6 finds no geometry at all.
    still = np.hypot(*(current - desired).T) <= EPIPOLAR_PX
    if still.sum() >= MIN_MATCHES and still.sum() > inliers.sum():
        # Any epipole does; with one in the middle, lines are those of driving ahead.
        return cross_matrix(np.append(desired[still].mean(axis=0), 1.0)), np.asarray(still)
    return geometry, inliers


def essential_matrices(current: FloatArray, desired: FloatArray, pixel: float) -> FloatArray:
    """
    Return E, (K, 3, 3), of unit rays, (N, 3), by USAC with several limits, a ``pixel`` [rad] wide.

    Those behind a camera are left out: OpenCV has no rays.
    """
    front = np.minimum(current[:, 2], desired[:, 2]) > LEAST_FORWARD
    points = image_points(current[front]), image_points(desired[front])
    found = [np.empty((0, 3, 3))]
    for part in (0.25, 0.5, 1.0):
        try:
            essential, _ = cv2.findEssentialMat(
                *points, np.eye(3), cv2.USAC_MAGSAC, CONFIDENCE, part * EPIPOLAR_PX * pixel
            )
        except cv2.error:  # of too few matches
            break
        if essential is not None and np.shape(essential) == (3, 3):
            found.append(np.asarray(essential)[None])
    return np.concatenate(found)


def share_on_plane(current: FloatArray, desired: FloatArray, pixel: float) -> float:
    """Return the share of unit rays, (N, 3), ahead, a ``pixel`` wide, that one plane explains."""
    points = image_points(current), image_points(desired)
    try:
        _, mask = cv2.findHomography(*points, cv2.USAC_MAGSAC, EPIPOLAR_PX * pixel)
    except cv2.error:  # of matches that coincide
        return 0.0
    return 0.0 if mask is None else float(mask.mean())


def agree_on_one_geometry(current: FloatArray, desired: FloatArray, pixel: float = 1.0) -> bool:
    """
    Return whether least squares find a geometry that all matches fit within EPIPOLAR_PX / 2.

    They are given as to ``epipolar_geometry``, and half its limit, for a fit by least squares
    bends towards an outlier. In most frames they do, and a robust search, which takes several
    times as long, has nothing to drop.
    """
    if len(current) < MIN_MATCHES:
        return False
    if current.shape[1] == 2:
        current, desired, pixel = _normalised(current, desired)
    products = constraint_rows(current, desired)
    if not np.isfinite(products).all():
        return False
    geometry = null_vector(products).reshape(3, 3)
    if current.shape[1] == 3:
        geometry = rank_two(geometry)
    distance = np.abs(sampson_distance(geometry, current, desired))
    return bool((distance <= 0.5 * EPIPOLAR_PX * pixel).all())


def _normalised(current: FloatArray, desired: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return both about their means, with the one scale that makes them one, and the scale."""
    pixels = np.stack([current, desired])
    pixels -= pixels.mean(axis=1, keepdims=True)
    spread = float(np.sqrt((pixels * pixels).mean()))
    scale = 1.0 / spread if spread > 0.0 else 1.0
    pixels *= scale
    return pixels[0], pixels[1], scale


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


def _essential(
    current: FloatArray, desired: FloatArray, pixel: float
) -> tuple[FloatArray | None, BoolArray]:
    """Return one robust E, (3, 3), of at least eight finite rays, and which fit it, (N,)."""
    nothing = np.zeros(len(current), bool)
    limit, products = EPIPOLAR_PX * pixel, constraint_rows(current, desired)
    # Without a baseline any geometry fits.
    still = np.linalg.norm(current - desired, axis=1) <= limit
    if still.sum() >= max(MIN_MATCHES, len(still) // 2):
        return cross_matrix(np.array([0.0, 0.0, 1.0])), np.asarray(still)
    essential = rank_two(null_vector(products).reshape(3, 3))
    essential, distance = _refined(essential, current, desired, products, limit)
    inliers = distance <= limit
    # More than that, and the others have no geometry of their own.
    if int(inliers.sum()) >= max(MIN_MATCHES, len(inliers) - MIN_MATCHES + 1):
        return essential, inliers
    best, inliers, least = None, nothing, math.inf
    for essential in _candidates(current, desired, products, limit):
        essential, distance = _refined(essential, current, desired, products, limit)
        cost = float(np.minimum(distance / limit, 1.0).sum())
        if cost < least:
            best, inliers, least = essential, distance <= limit, cost
    return (best, inliers) if int(inliers.sum()) >= MIN_MATCHES else (None, nothing)


def _candidates(
    current: FloatArray, desired: FloatArray, products: FloatArray, limit: float
) -> FloatArray:
    """Return the best hypotheses of either kind, (K, 3, 3)."""
    rng = np.random.default_rng(len(products))
    best = []
    for size, columns, tolerance in ((3, PLANAR, LEVEL * limit), (8, np.arange(9), limit)):
        rows = products[samples(rng, SAMPLES, len(products), size)][..., columns]
        vectors = np.zeros((len(rows), 9))
        vectors[:, columns] = null_vector(rows)
        hypotheses = vectors.reshape(-1, 3, 3)
        distance = np.abs(sampson_distance(hypotheses, current, desired))
        cost = np.minimum(distance / tolerance, 1.0).sum(axis=1)
        best.append(hypotheses[np.argsort(cost, kind='stable')[:BEST]])
    return np.concatenate(best)


def _refined(
    essential: FloatArray,
    current: FloatArray,
    desired: FloatArray,
    products: FloatArray,
    limit: float,
) -> tuple[FloatArray, FloatArray]:
    """Return E, (3, 3), of all that fit it, by ever closer limits, and the distances from it."""
    distance = np.abs(sampson_distance(essential, current, desired))
    for tolerance in np.geomspace(LEVEL * limit, limit, REWEIGHTINGS):
        weight = cauchy(distance * distance, 0.25 * tolerance * tolerance) ** 2
        weight[distance > 2.0 * tolerance] = 0.0
        if np.count_nonzero(weight) < MIN_MATCHES:
            break
        essential = rank_two(null_vector(products, weight).reshape(3, 3))
        distance = np.abs(sampson_distance(essential, current, desired))
    return essential, distance
