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
    previous: Frame,
    frame: Frame,
    points: Points,
    *,
    settings: TrackerSettings,
    coarse: bool = False,
    both_ways: bool = False,
) -> tuple[Points, BoolArray]:
    """
    Return where ``points``, (N, 2), of a ``previous`` frame are, and which were followed, (N,).

    A ``coarse`` flow, to be aligned yet, is that of images at half their size: within half a
    pixel, in a fraction of the time. ``both_ways`` the flow back must return within
    ``forward_backward`` [px] as well.
    """
    if not len(points):  # of which OpenCV returns None
        return points, np.zeros(0, bool)
    halved = coarse and settings.levels > 0 and min(frame.image.shape) >= LEAST_HALVED
    source, target = (previous.half, frame.half) if halved else (previous.image, frame.image)
    gain = frame.brightness / max(previous.brightness, 1.0)
    if abs(gain - 1.0) >= NOTICEABLE_GAIN:  # Lucas-Kanade takes a change of light for motion
        source = np.asarray(cv2.convertScaleAbs(source, alpha=gain), dtype=np.uint8)
    part = np.float32(0.5 if halved else 1.0)
    before = points * part
    pixels, valid = _followed(source, target, before, None, settings, halved)
    if both_ways:
        back, returned = _followed(target, source, pixels, before, settings, halved)
        off = np.hypot(*(back - before).T) / part
        valid = valid & returned & (off <= settings.forward_backward)
    return pixels / part, valid


def _followed(
    source: Image,
    target: Image,
    points: Points,
    guess: Points | None,
    settings: TrackerSettings,
    halved: bool,
) -> tuple[Points, BoolArray]:
    """Return the pixels of ``points`` in the ``target``, and OpenCV's status."""
    # Halved, as much of the scene: a larger window reaches over more edges in depth.
    window = settings.window // 2 | 1 if halved else settings.window
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
