"""Optical flow: pyramidal Lucas-Kanade (Bouguet 2001, in OpenCV) from image to image."""

from functools import cached_property
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, Image
from visual_servo_epipolar.core.tracking.settings import TrackerSettings

NOTICEABLE_GAIN = 0.02  # change of brightness that is corrected for
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01)  # iterations, step [px]
COARSE_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.03)
LEAST_WINDOW = 5  # side of the window in the half of an image [px]
LEAST_HALVED = 400  # sides of an image from which its half shows enough [px]

Points: TypeAlias = NDArray[np.float32]  # pixels for OpenCV's flow, shape (N, 2)
OpenCVError: type[Exception] = cv2.error


class Frame:
    """Frame: an ``image``, uint8 of shape (H, W), and what of it two flows need, made once."""

    def __init__(self, image: Image) -> None:
        self.image = image

    @cached_property
    def half(self) -> Image:
        """The image at half its size."""
        return np.asarray(cv2.pyrDown(self.image), dtype=np.uint8)

    @cached_property
    def brightness(self) -> float:
        """The mean of every eighth pixel."""
        few = np.ascontiguousarray(self.image[::8, ::8])
        return float(cv2.sumElems(few)[0]) / few.size


def flow(
    source: Image,
    target: Image,
    points: Points,
    guess: Points | None = None,
    *,
    settings: TrackerSettings,
    halved: bool = False,
) -> tuple[Points, BoolArray]:
    """
    Return the flow of ``points`` from ``source`` to ``target``: their pixels there, and validity.

    Images are uint8 of shape (H, W), ``points`` and the initial ``guess`` pixels of shape (N, 2).
    Validity, shape (N,), is OpenCV's status. Of ``halved`` images one level less is made, and
    coarser steps end the search.
    """
    if not len(points):  # of which OpenCV returns None
        return points, np.zeros(0, bool)
    # As much of the scene: a larger window reaches over more edges in depth.
    window = max(LEAST_WINDOW, settings.window // 2 | 1) if halved else settings.window
    pixels, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        points,
        None if guess is None else guess.copy(),
        winSize=(window, window),
        maxLevel=settings.levels - halved,
        criteria=COARSE_CRITERIA if halved else CRITERIA,
        flags=0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return pixels, np.asarray(status.ravel() > 0)


def coarse_flow(
    previous: Frame,
    frame: Frame,
    points: Points,
    *,
    settings: TrackerSettings,
    both_ways: bool = False,
) -> tuple[Points, BoolArray]:
    """
    Return the flow of ``points`` from ``previous`` to ``frame``, to be aligned yet.

    The half of an image places a feature within half a pixel, where an alignment finds it, in a
    fraction of the time. Where nothing aligns it, the flow ``both_ways`` must return within
    ``forward_backward`` [px].
    """
    halved = bool(settings.levels) and min(frame.image.shape) >= LEAST_HALVED
    source = previous.half if halved else previous.image
    source, target = _scaled(source, previous, frame), frame.half if halved else frame.image
    part = np.float32(0.5 if halved else 1.0)
    before = points * part
    pixels, valid = flow(source, target, before, settings=settings, halved=halved)
    if both_ways and len(points):
        back, returned = flow(target, source, pixels, before, settings=settings, halved=halved)
        off = np.hypot(*(back - before).T) / part
        valid = valid & returned & (off <= settings.forward_backward)
    return pixels / part, valid


def checked_flow(
    previous: Frame, frame: Frame, points: Points, *, settings: TrackerSettings
) -> tuple[Points, BoolArray]:
    """
    Return the flow of ``points`` from ``previous`` to ``frame``, brightness equalised first.

    Without alignment (``anchor_period`` 0) the flow back must return within ``forward_backward``
    [px] as well; with it the patch in the desired image is the judge.
    """
    source = equalised(previous, frame)
    pixels, valid = flow(source, frame.image, points, settings=settings)
    if settings.anchor_period == 0:
        back, back_valid = flow(frame.image, source, pixels, points, settings=settings)
        valid &= back_valid & (np.hypot(*(back - points).T) <= settings.forward_backward)
    return pixels, valid


def equalised(previous: Frame, frame: Frame) -> Image:
    """
    Return the image of ``previous`` scaled to the mean brightness of ``frame``.

    Lucas-Kanade takes a change of light for motion.
    """
    return _scaled(previous.image, previous, frame)


def _scaled(image: Image, previous: Frame, frame: Frame) -> Image:
    gain = frame.brightness / max(previous.brightness, 1.0)
    if abs(gain - 1.0) < NOTICEABLE_GAIN:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), dtype=np.uint8)
