"""Matching of the desired with a current image: SIFT, ratio test, one epipolar geometry."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import as_gray, BoolArray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.significance import log_false_alarms
from visual_servo_epipolar.core.tracking.alignment.sampling import patch_radius
from visual_servo_epipolar.core.tracking.descriptors import mutual_nearest
from visual_servo_epipolar.core.tracking.robust_geometry import epipolar_geometry, MIN_MATCHES

CORNER_WINDOW = 15  # side of the window of the corner measure [px]
BORDER = 2  # so much farther than a patch's radius from the border of the desired image [px]
ENOUGH = 500  # keypoints of a photograph with which its detector is good enough
LEAST_SIDE, LARGEST_SIDE = (
    16,
    32766,
)  # of an image [px]: SIFT needs a pyramid; cv2.remap has limits
LARGEST_ENLARGED = 640 * 480  # image that is worth being enlarged [px]
PIXEL_STRIDE = 1 << 20  # more than the side of any image, enlarged
CHANCE = -2.0  # log10 of the false alarms of a geometry that are expected at most


@dataclass(frozen=True, slots=True)
class Detector:
    """Detector: SIFT with a least ``contrast``, in the image times ``enlargement``."""

    contrast: float
    enlargement: int


# OpenCV's own contrast first; a photograph with little texture takes the weaker ones.
DETECTORS = Detector(0.04, 1), Detector(0.01, 1), Detector(0.01, 2)


@dataclass(frozen=True, slots=True, eq=False)
class Keypoints:
    """
    SIFT keypoints of one image.

    ``pixels``, shape (N, 2); ``sizes``, shape (N,), diameters [px]; ``angles``, shape (N,), of
    the steepest gradient [rad]; ``descriptors``, shape (N, 128).
    """

    pixels: FloatArray
    sizes: FloatArray
    angles: FloatArray
    descriptors: NDArray[np.float32]

    @classmethod
    def empty(cls) -> 'Keypoints':
        """Return no keypoint."""
        return cls(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty((0, 128), np.float32))

    def __len__(self) -> int:
        return len(self.pixels)

    def take(self, rows: IntArray | BoolArray) -> 'Keypoints':
        """Return the rows chosen by index, shape (M,), or mask, shape (N,)."""
        return Keypoints(
            self.pixels[rows], self.sizes[rows], self.angles[rows], self.descriptors[rows]
        )


@dataclass(frozen=True, slots=True, eq=False)
class DesiredView:
    """
    Desired view: the photograph to come back to.

    ``image``, uint8 of shape (H, W); its N ``keypoints``; ``corners``, shape (N,), the smaller
    eigenvalue of the gradient matrix around each (Shi and Tomasi 1994); the ``detector`` with
    which it shows enough, for the images that are matched with it.
    """

    image: Image
    keypoints: Keypoints
    corners: FloatArray
    detector: Detector


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


def detect(
    image: Image, *, limit: int, detector: Detector = DETECTORS[0], halved: bool = False
) -> Keypoints:
    """
    Detect at most ``limit`` SIFT keypoints of ``image``, uint8 of shape (H, W), one a pixel.

    Sorted, because OpenCV's order differs from call to call, and without the copies that SIFT
    makes of a keypoint for each of its orientations. None in an image of less than LEAST_SIDE;
    ``halved`` it takes a quarter of the time.
    """
    if min(image.shape) < LEAST_SIDE:
        return Keypoints.empty()
    scale = 0.5 * detector.enlargement if halved else float(detector.enlargement)
    sift = cv2.SIFT_create(nfeatures=limit, contrastThreshold=detector.contrast)
    points, descriptors = sift.detectAndCompute(_scaled(image, scale), None)
    if descriptors is None:
        return Keypoints.empty()
    pixels = np.array([point.pt for point in points], dtype=np.float64)
    sizes = np.array([point.size for point in points])
    responses = np.array([point.response for point in points])
    angles = np.array([point.angle for point in points])
    order = np.lexsort((angles, sizes, -responses, pixels[:, 1], pixels[:, 0]))
    # One number a pixel: rows take several times as long.
    columns, rows = np.rint(pixels[order]).astype(np.int64).T
    _, first = np.unique(columns * PIXEL_STRIDE + rows, return_index=True)
    # A pixel of a small image is centred between two of a large one.
    pixels, sizes = pixels / scale + (0.5 / scale - 0.5), sizes / scale
    return Keypoints(pixels, sizes, np.radians(angles), descriptors).take(order[np.sort(first)])


def _scaled(image: Image, scale: float) -> Image:
    if scale == 1.0:
        return image
    height, width = image.shape
    size = int(scale * width), int(scale * height)
    kind = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, size, interpolation=kind), dtype=np.uint8)


def desired_view(image: Image, *, limit: int = 4000) -> DesiredView:
    """
    Return the desired view of ``image``, with at most ``limit`` keypoints.

    Raises
    ------
    ValueError
        If ``image`` is not uint8 of shape (H, W), or larger than OpenCV can sample.
    TrackingError
        If it shows fewer than eight features: a blank wall, a lens cap.

    """
    image = as_gray(image, 'desired image').copy()
    if max(image.shape) > LARGEST_SIDE:
        raise ValueError(
            f'desired image must have sides of at most {LARGEST_SIDE} px, got '
            f'{image.shape[1]}x{image.shape[0]}; take a smaller one'
        )
    keypoints, detector = _sufficient(image, limit)
    if len(keypoints) < MIN_MATCHES:
        raise TrackingError(
            f'the desired image shows {len(keypoints)} features, at least {MIN_MATCHES} are '
            'needed; take the photograph where there is texture and light'
        )
    measure = cv2.cornerMinEigenVal(image, CORNER_WINDOW, ksize=3)
    columns, rows = np.rint(keypoints.pixels).astype(int).T
    corners = measure[rows, columns].astype(np.float64)
    return DesiredView(image, keypoints, corners, detector)


def _sufficient(image: Image, limit: int) -> tuple[Keypoints, Detector]:
    """Return the keypoints by the first detector that finds enough, or by the last one."""
    border = patch_radius(image.shape) + BORDER
    for detector in DETECTORS:
        if detector.enlargement > 1 and image.size > LARGEST_ENLARGED:
            break
        keypoints, used = detect(image, limit=limit, detector=detector), detector
        keypoints = keypoints.take(inside_border(keypoints.pixels, image.shape, border))
        if len(keypoints) >= ENOUGH:
            break
    return keypoints, used


def match(view: DesiredView, image: Image, *, limit: int = 4000, halved: bool = False) -> Matches:
    """
    Find the keypoints of ``view`` in ``image``.

    Mutual nearest descriptors that pass Lowe's ratio test, then one robust epipolar geometry that
    all must fit, and more of them than by chance. ``image`` is uint8 of shape (H, W); ``halved``
    it takes a quarter of the time and gives fewer matches.

    Raises
    ------
    TrackingError
        If fewer than eight matches agree on one epipolar geometry, or no more than those of
        another place would.

    """
    keypoints = detect(as_gray(image), limit=limit, detector=view.detector, halved=halved)
    pairs = mutual_nearest(view.keypoints.descriptors, keypoints.descriptors)
    desired, current = view.keypoints.take(pairs[:, 0]), keypoints.take(pairs[:, 1])
    geometry, inliers = epipolar_geometry(current.pixels, desired.pixels)
    if geometry is None or int(inliers.sum()) < MIN_MATCHES:
        raise TrackingError(
            f'the photograph is not seen from here: {len(pairs)} matches of which '
            f'{int(inliers.sum())} agree on one geometry, {MIN_MATCHES} needed; turn the robot '
            'towards it'
        )
    if log_false_alarms(geometry, _frames(current), _frames(desired), inliers) > CHANCE:
        raise TrackingError(
            f'the photograph is not seen from here: {int(inliers.sum())} of {len(pairs)} matches '
            'agree on one geometry, no more than by chance; turn the robot towards it, or take a '
            'photograph of this place'
        )
    pairs = pairs[inliers]
    scales = keypoints.sizes[pairs[:, 1]] / view.keypoints.sizes[pairs[:, 0]]
    return Matches(pairs[:, 0], keypoints.pixels[pairs[:, 1]], scales)


def _frames(keypoints: Keypoints) -> FloatArray:
    """Return pixel, angle [rad] and logarithm of the size of each, shape (N, 4)."""
    return np.column_stack([keypoints.pixels, keypoints.angles, np.log2(keypoints.sizes)])


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


def inside_border(pixels: FloatArray, shape: tuple[int, ...], border: float) -> BoolArray:
    """
    Return which of ``pixels``, shape (N, 2), keep ``border`` [px] from the border, shape (N,).

    ``shape`` is height and width of the image [px].
    """
    height, width = shape
    u, v = pixels[:, 0], pixels[:, 1]
    inside = (u >= border) & (u < width - border) & (v >= border) & (v < height - border)
    return np.asarray(inside)
