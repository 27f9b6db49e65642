"""
RootSIFT (Lowe 2004; Arandjelovic and Zisserman 2012): ratio test, mutual nearest neighbours.

The least contrast of a keypoint follows the noise of each image, so that a dim image shows what a
bright one does, and noise shows nothing.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import Image, IntArray
from visual_servo_epipolar.core.geometry.epipolar import MIN_MATCHES
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints, mutual_nearest
from visual_servo_epipolar.core.tracking.sampling import (
    inside_border,
    LEAST_NOISE,
    noise,
    USUAL_SIZE,
)

ENOUGH = 500  # keypoints of a photograph: a small one with fewer is worth being enlarged
ENLARGEMENT = 2
LEAST_SIDE = 16  # of an image [px]: SIFT needs a pyramid
LAYERS = 3  # of an octave
# Least difference of Gaussians, over the deviation of the noise: a blank wall shows nothing.
CONTRAST = 0.4
DESCRIPTOR_NORM = 512.0  # of whole numbers, as OpenCV has them


class Sift:
    """Matcher by SIFT, of images at twice their size where the photograph shows little."""

    def describe(self, image: Image, *, limit: int, border: float) -> Keypoints:
        """Return the keypoints, of a small photograph that shows few those of it enlarged."""
        keypoints = self._described(image, limit, border, 1)
        if MIN_MATCHES <= len(keypoints) < ENOUGH and image.size <= USUAL_SIZE:
            keypoints = self._described(image, limit, border, ENLARGEMENT)
        return keypoints

    def _described(self, image: Image, limit: int, border: float, enlargement: int) -> Keypoints:
        keypoints = detect(image, limit=limit, enlargement=enlargement)
        keypoints = keypoints.take(inside_border(keypoints.pixels, image.shape, border))
        return replace(keypoints, tuning=enlargement)

    def detect(self, image: Image, tuning: object, *, limit: int, quick: bool) -> Keypoints:
        """Return the keypoints of ``image``, of the halved one if ``quick``."""
        assert isinstance(tuning, int)
        return detect(image, limit=limit, enlargement=tuning, halved=quick)

    def pairs(self, desired: Keypoints, current: Keypoints) -> IntArray:
        """Return those that are each other's nearest, and nearer than others."""
        return mutual_nearest(desired.descriptors, current.descriptors)


SIFT = Sift()


def detect(image: Image, *, limit: int, enlargement: int = 1, halved: bool = False) -> Keypoints:
    """
    Detect at most ``limit`` SIFT keypoints of ``image``, uint8 of shape (H, W), one a pixel.

    Sorted, because OpenCV's order differs from call to call, and without the copies that SIFT
    makes of a keypoint for each of its orientations. None in an image of less than LEAST_SIDE;
    ``halved`` it takes a quarter of the time.
    """
    if min(image.shape) < LEAST_SIDE:
        return Keypoints.empty()
    scale = 0.5 * enlargement if halved else float(enlargement)
    deviation = max(noise(image) * min(scale, 1.0), LEAST_NOISE)
    least = LAYERS * CONTRAST * deviation / 255.0
    sift = cv2.SIFT_create(nfeatures=limit, contrastThreshold=least)
    scaled = _scaled(image, scale)
    points, descriptors = sift.detectAndCompute(scaled, None)
    if descriptors is None:
        return Keypoints.empty()
    pixels = np.array([point.pt for point in points], dtype=np.float64)
    sizes = np.array([point.size for point in points])
    responses = np.array([point.response for point in points])
    angles = np.array([point.angle for point in points])
    order = np.lexsort((angles, sizes, -responses, pixels[:, 1], pixels[:, 0]))
    # One number a pixel: rows take several times as long.
    columns, rows = np.rint(pixels[order]).astype(np.int64).T
    _, first = np.unique(columns * scaled.size + rows, return_index=True)
    # A pixel of a small image is centred between two of a large one.
    pixels, sizes = pixels / scale + (0.5 / scale - 0.5), sizes / scale
    roots = _roots(descriptors)
    return Keypoints(pixels, sizes, np.radians(angles), roots).take(order[np.sort(first)])


def _roots(descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the roots of ``descriptors``, shape (N, 128), whole numbers of one norm."""
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1.0)
    roots = np.rint(DESCRIPTOR_NORM * np.sqrt(descriptors / total))
    return np.asarray(roots, dtype=np.float32)


def _scaled(image: Image, scale: float) -> Image:
    if scale == 1.0:
        return image
    height, width = image.shape
    size = int(scale * width), int(scale * height)
    kind = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, size, interpolation=kind), dtype=np.uint8)
