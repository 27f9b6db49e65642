"""Optical flow: pyramidal Lucas-Kanade (Bouguet 2001, in OpenCV) from image to image."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, Image
from visual_servo_epipolar.core.tracking.settings import TrackerSettings

NOTICEABLE_GAIN = 0.02  # change of brightness that is corrected for
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01)  # iterations, step [px]

Points: TypeAlias = NDArray[np.float32]  # pixels for OpenCV's flow, shape (N, 2)
OpenCVError: type[Exception] = cv2.error


def flow(
    source: Image,
    target: Image,
    points: Points,
    guess: Points | None = None,
    *,
    settings: TrackerSettings,
) -> tuple[Points, BoolArray]:
    """
    Return the flow of ``points`` from ``source`` to ``target``: their pixels there, and validity.

    Images are uint8 of shape (H, W), ``points`` and the initial ``guess`` pixels of shape (N, 2).
    Validity, shape (N,), is OpenCV's status.
    """
    if not len(points):  # of which OpenCV returns None
        return points, np.zeros(0, bool)
    pixels, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        points,
        None if guess is None else guess.copy(),
        winSize=(settings.window, settings.window),
        maxLevel=settings.levels,
        criteria=CRITERIA,
        flags=0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return pixels, np.asarray(status.ravel() > 0)


def checked_flow(
    previous: Image, image: Image, points: Points, *, settings: TrackerSettings
) -> tuple[Points, BoolArray]:
    """
    Return the flow of ``points`` from ``previous`` to ``image``, brightness equalised first.

    Without alignment (``anchor_period`` 0) the flow back must return within ``forward_backward``
    [px] as well; with it the patch in the desired image is the judge.
    """
    previous = equalised(previous, image)
    pixels, valid = flow(previous, image, points, settings=settings)
    if settings.anchor_period == 0:
        back, back_valid = flow(image, previous, pixels, points, settings=settings)
        valid &= back_valid & (np.hypot(*(back - points).T) <= settings.forward_backward)
    return pixels, valid


def equalised(image: Image, reference: Image) -> Image:
    """
    Return ``image`` scaled to the mean brightness of ``reference``, both uint8 of shape (H, W).

    Lucas-Kanade takes a change of light for motion.
    """
    gain = float(reference[::8, ::8].mean()) / max(float(image[::8, ::8].mean()), 1.0)
    if abs(gain - 1.0) < NOTICEABLE_GAIN:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), dtype=np.uint8)
