"""The desired image and its first match: SIFT, ratio test, epipolar check."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.errors import TrackingError

RATIO = 0.8
EPIPOLAR_PX = 2.0
MIN_MATCHES = 8
CONFIDENCE = 0.999
ITERATIONS = 5000
CORNER_WINDOW = 15  # window of the corner measure [px], as large as what LK looks at
GRID = (4, 3)  # coarse parts of an image
CELLS = GRID[0] * GRID[1]
BORDER = 12  # features nearer to the border of the desired image are left alone [px]


@dataclass(frozen=True, slots=True, eq=False)
class Keypoints:
    """
    SIFT keypoints of one image.

    ``pixels``, shape (N, 2); ``sizes``, shape (N,), diameters [px]; ``descriptors``, (N, 128).
    """

    pixels: FloatArray
    sizes: FloatArray
    descriptors: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class DesiredView:
    """The photograph to come back to: its image, its keypoints, and how good a corner each is."""

    image: Image
    keypoints: Keypoints
    corners: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """
    Keypoints of the desired view found in a current image.

    ``indices``, shape (M,), into the keypoints of the view; ``pixels``, shape (M, 2), current;
    ``scales``, shape (M,), size in the current over size in the desired image.
    """

    indices: IntArray
    pixels: FloatArray
    scales: FloatArray


def detect(image: Image, *, limit: int) -> Keypoints:
    """
    Detect at most ``limit`` SIFT keypoints, one at each pixel.

    SIFT repeats a place for each of its orientations, and in an order that is not the same twice.
    """
    points, descriptors = cv2.SIFT_create(nfeatures=limit).detectAndCompute(image, None)
    if descriptors is None:
        return Keypoints(np.empty((0, 2)), np.empty(0), np.empty((0, 128), np.float32))
    pixels = np.array([point.pt for point in points], dtype=np.float64)
    sizes = np.array([point.size for point in points])
    strength = np.array([point.response for point in points])
    angles = np.array([point.angle for point in points])
    order = np.lexsort((angles, sizes, -strength, pixels[:, 1], pixels[:, 0]))
    _, first = np.unique(np.rint(pixels[order]), axis=0, return_index=True)
    kept = order[np.sort(first)]
    return Keypoints(pixels[kept], sizes[kept], descriptors[kept])


def desired_view(image: Image, *, limit: int = 4000) -> DesiredView:
    """
    Prepare the desired image for matching and tracking.

    Raises
    ------
    ValueError
        If ``image`` is not uint8 of shape (H, W).
    TrackingError
        If it shows fewer than eight features: a blank wall, a lens cap.

    """
    image = as_gray(image, 'desired image').copy()
    keypoints = detect(image, limit=limit)
    height, width = image.shape
    u, v = keypoints.pixels[:, 0], keypoints.pixels[:, 1]
    inside = (u >= BORDER) & (u < width - BORDER) & (v >= BORDER) & (v < height - BORDER)
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
    all must fit. On the ``halved`` image it takes a quarter of the time and finds fewer.

    Raises
    ------
    TrackingError
        If fewer than eight matches agree on one epipolar geometry.

    """
    image = as_gray(image)
    found = _detect_halved(image, limit=limit) if halved else detect(image, limit=limit)
    pairs = _mutual(view.keypoints.descriptors, found.descriptors)
    desired, current = view.keypoints.pixels[pairs[:, 0]], found.pixels[pairs[:, 1]]
    agree = epipolar_inliers(current, desired)
    if int(agree.sum()) < MIN_MATCHES:
        raise TrackingError(
            f'the desired view is not seen: {len(pairs)} matches of which {int(agree.sum())} '
            f'agree on one geometry, {MIN_MATCHES} needed; turn the robot towards it'
        )
    pairs = pairs[agree]
    scales = found.sizes[pairs[:, 1]] / view.keypoints.sizes[pairs[:, 0]]
    return Matches(pairs[:, 0], found.pixels[pairs[:, 1]], scales)


def _detect_halved(image: Image, *, limit: int) -> Keypoints:
    height, width = image.shape
    small = cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    found = detect(np.asarray(small, dtype=np.uint8), limit=limit)
    # A pixel of the small image is centred between two of the large one.
    return Keypoints(2.0 * found.pixels + 0.5, 2.0 * found.sizes, found.descriptors)


def _mutual(desired: NDArray[np.float32], current: NDArray[np.float32]) -> IntArray:
    """
    Return index pairs (desired, current) that are each other's nearest, shape (M, 2).

    By one matrix product: several times as fast as a brute-force matcher that goes both ways.
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
    kept = np.flatnonzero(distinct & (back[nearest] == rows))
    return np.stack([kept, nearest[kept]], axis=1).astype(np.int64)


def epipolar_inliers(current: FloatArray, desired: FloatArray) -> BoolArray:
    """Return which matches, shape (N, 2) in pixels, fit one epipolar geometry, shape (N,)."""
    if len(current) < MIN_MATCHES:
        return np.zeros(len(current), bool)
    found, mask = cv2.findFundamentalMat(
        current, desired, cv2.USAC_MAGSAC, EPIPOLAR_PX, CONFIDENCE, ITERATIONS
    )
    if found is None or mask is None:
        return np.zeros(len(current), bool)
    return np.asarray(mask.ravel() > 0)


def cells(pixels: FloatArray, size: tuple[int, int]) -> IntArray:
    """Return in which part of an image of ``size`` (width, height) each pixel is, shape (N,)."""
    columns, rows = GRID
    column = np.clip(pixels[:, 0] * columns / size[0], 0, columns - 1).astype(np.int64)
    row = np.clip(pixels[:, 1] * rows / size[1], 0, rows - 1).astype(np.int64)
    return np.asarray(row * columns + column)


def spread(pixels: FloatArray, quality: FloatArray, count: int, size: tuple[int, int]) -> IntArray:
    """
    Choose ``count`` points spread over an image, best quality first within each cell.

    Parameters
    ----------
    pixels : array, shape (N, 2)
        Candidates.
    quality : array, shape (N,)
        Larger is better.
    count : int
        How many to choose; all when there are not so many.
    size : (int, int)
        Width and height of the image [px].

    Returns
    -------
    indices : array, shape (min(N, count),)
        The chosen rows in ascending order.

    """
    columns = max(2, round((1.5 * count) ** 0.5))
    rows = max(2, round(columns * size[1] / size[0]))
    cell_u = np.clip(pixels[:, 0] * columns / size[0], 0, columns - 1).astype(int)
    cell_v = np.clip(pixels[:, 1] * rows / size[1], 0, rows - 1).astype(int)
    cell = cell_v * columns + cell_u
    order = np.lexsort((-quality, cell))
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    within = np.arange(len(order)) - np.repeat(starts, np.diff(starts, append=len(order)))
    rank = np.empty(len(order), np.int64)
    rank[order] = within
    best_first = np.lexsort((-quality, rank))  # every cell's best, then every second best, ...
    return np.sort(best_first[:count])
