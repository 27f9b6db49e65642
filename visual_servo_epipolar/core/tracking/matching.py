"""Matching of the desired with a current image: SIFT, ratio test, one epipolar geometry."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.errors import TrackingError

RATIO = 0.8  # of the nearest to the second nearest descriptor distance (Lowe 2004)
EPIPOLAR_PX = 2.0  # largest distance of an inlier from its epipolar line
MIN_MATCHES = 8
CONFIDENCE = 0.999
ITERATIONS = 5000
CORNER_WINDOW = 15  # side of the window of the corner measure [px]
BORDER = 12  # features nearer to the border of the desired image are left alone [px]


@dataclass(frozen=True, slots=True, eq=False)
class Keypoints:
    """
    SIFT keypoints of one image.

    ``pixels``, shape (N, 2); ``sizes``, shape (N,), diameters [px]; ``descriptors``, shape
    (N, 128).
    """

    pixels: FloatArray
    sizes: FloatArray
    descriptors: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class DesiredView:
    """
    Desired view: the photograph to come back to.

    ``image``, uint8 of shape (H, W); its N ``keypoints``; ``corners``, shape (N,), the smaller
    eigenvalue of the gradient matrix around each (Shi and Tomasi 1994).
    """

    image: Image
    keypoints: Keypoints
    corners: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """
    Matches of a desired view with a current image, rows are matches.

    ``indices``, shape (M,), into the keypoints of the view; ``pixels``, shape (M, 2), in the
    current image; ``scales``, shape (M,), size in the current over size in the desired image.
    """

    indices: IntArray
    pixels: FloatArray
    scales: FloatArray


def detect(image: Image, *, limit: int) -> Keypoints:
    """
    Detect at most ``limit`` SIFT keypoints of ``image``, uint8 of shape (H, W), one a pixel.

    Sorted, because OpenCV's order differs from call to call, and without the copies that SIFT
    makes of a keypoint for each of its orientations.
    """
    points, descriptors = cv2.SIFT_create(nfeatures=limit).detectAndCompute(image, None)
    if descriptors is None:
        return Keypoints(np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.float32))
    pixels = np.array([point.pt for point in points], dtype=np.float64)
    sizes = np.array([point.size for point in points])
    responses = np.array([point.response for point in points])
    angles = np.array([point.angle for point in points])
    order = np.lexsort((angles, sizes, -responses, pixels[:, 1], pixels[:, 0]))
    _, first = np.unique(np.rint(pixels[order]), axis=0, return_index=True)
    rows = order[np.sort(first)]
    return Keypoints(pixels[rows], sizes[rows], descriptors[rows])


def desired_view(image: Image, *, limit: int = 4000) -> DesiredView:
    """
    Return the desired view of ``image``, with at most ``limit`` keypoints.

    Raises
    ------
    ValueError
        If ``image`` is not uint8 of shape (H, W).
    TrackingError
        If it shows fewer than eight features: a blank wall, a lens cap.

    """
    image = as_gray(image, 'desired image').copy()
    keypoints = detect(image, limit=limit)
    inside = inside_border(keypoints.pixels, image.shape, BORDER)
    if int(inside.sum()) < MIN_MATCHES:
        raise TrackingError(
            f'the desired image shows {int(inside.sum())} features, at least {MIN_MATCHES} are '
            'needed; take the photograph where there is texture and light'
        )
    keypoints = Keypoints(
        keypoints.pixels[inside], keypoints.sizes[inside], keypoints.descriptors[inside]
    )
    measure = cv2.cornerMinEigenVal(image, CORNER_WINDOW, ksize=3)
    columns, rows = np.rint(keypoints.pixels).astype(int).T
    return DesiredView(image, keypoints, measure[rows, columns].astype(np.float64))


def match(view: DesiredView, image: Image, *, limit: int = 4000, halved: bool = False) -> Matches:
    """
    Find the keypoints of ``view`` in ``image``.

    Mutual nearest descriptors that pass Lowe's ratio test, then one robust epipolar geometry that
    all must fit. ``image`` is uint8 of shape (H, W); ``halved`` it takes a quarter of the time and
    gives fewer matches.

    Raises
    ------
    TrackingError
        If fewer than eight matches agree on one epipolar geometry.

    """
    image = as_gray(image)
    keypoints = _detect_halved(image, limit=limit) if halved else detect(image, limit=limit)
    pairs = _mutual_nearest(view.keypoints.descriptors, keypoints.descriptors)
    desired, current = view.keypoints.pixels[pairs[:, 0]], keypoints.pixels[pairs[:, 1]]
    inliers = epipolar_inliers(current, desired)
    if int(inliers.sum()) < MIN_MATCHES:
        raise TrackingError(
            f'the desired view is not seen: {len(pairs)} matches of which {int(inliers.sum())} '
            f'agree on one geometry, {MIN_MATCHES} needed; turn the robot towards it'
        )
    pairs = pairs[inliers]
    scales = keypoints.sizes[pairs[:, 1]] / view.keypoints.sizes[pairs[:, 0]]
    return Matches(pairs[:, 0], keypoints.pixels[pairs[:, 1]], scales)


def match_quickly(view: DesiredView, image: Image, *, enough: int) -> Matches:
    """
    Match ``view`` with the halved ``image``, or with the whole one where that gives too little.

    Raises TrackingError as ``match`` if fewer than eight agree even then; ``enough`` is the number
    of matches with which the halved image is good enough.
    """
    try:
        matches = match(view, image, halved=True)
    except TrackingError:
        return match(view, image)
    return matches if len(matches.indices) >= enough else match(view, image)


def _detect_halved(image: Image, *, limit: int) -> Keypoints:
    height, width = image.shape
    small = cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    keypoints = detect(np.asarray(small, dtype=np.uint8), limit=limit)
    # A pixel of the small image is centred between two of the large one.
    return Keypoints(2.0 * keypoints.pixels + 0.5, 2.0 * keypoints.sizes, keypoints.descriptors)


def _mutual_nearest(desired: NDArray[np.float32], current: NDArray[np.float32]) -> IntArray:
    """
    Return index pairs (desired, current) that are each other's nearest, shape (M, 2).

    By one matrix product: several times as fast as two brute-force matchings.
    """
    if len(desired) < 2 or len(current) < 2:
        return np.empty((0, 2), np.int64)
    squared = -2.0 * (desired @ current.T)
    squared += np.einsum('nk,nk->n', desired, desired)[:, None]
    squared += np.einsum('nk,nk->n', current, current)[None, :]
    rows = np.arange(len(desired))
    nearest, back = squared.argmin(axis=1), squared.argmin(axis=0)
    best = squared[rows, nearest]
    squared[rows, nearest] = np.inf
    distinct = best < RATIO**2 * squared.min(axis=1)
    mutual = np.flatnonzero(distinct & (back[nearest] == rows))
    return np.stack([mutual, nearest[mutual]], axis=1).astype(np.int64)


def epipolar_inliers(current: FloatArray, desired: FloatArray) -> BoolArray:
    """
    Return the inliers of one robust epipolar geometry, shape (N,).

    ``current`` and ``desired`` are the pixels of N matches, shape (N, 2) each; none of fewer than
    eight is an inlier.
    """
    if len(current) < MIN_MATCHES:
        return np.zeros(len(current), bool)
    try:
        fundamental, mask = cv2.findFundamentalMat(
            current, desired, cv2.USAC_MAGSAC, EPIPOLAR_PX, CONFIDENCE, ITERATIONS
        )
    except cv2.error:  # OpenCV 5 asserts that there is a model, where few matches gave none
        return np.zeros(len(current), bool)
    if fundamental is None or mask is None:
        return np.zeros(len(current), bool)
    return np.asarray(mask.ravel() > 0)


def inside_border(pixels: FloatArray, shape: tuple[int, ...], border: float) -> BoolArray:
    """
    Return which of ``pixels``, shape (N, 2), keep ``border`` [px] from the border, shape (N,).

    ``shape`` is height and width of the image [px].
    """
    height, width = shape
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (u >= border) & (u < width - border) & (v >= border) & (v < height - border)
    return np.asarray(inside)
