"""Pyramidal Lucas-Kanade from one image to the next (Bouguet 2001, as OpenCV has it)."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, Image
from visual_servo_epipolar.core.tracking.settings import TrackerSettings

NOTICEABLE_GAIN = 0.02
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01)

Points: TypeAlias = NDArray[np.float32]  # as OpenCV's flow wants them, shape (N, 2)


def flow(
    source: Image,
    target: Image,
    points: Points,
    guess: Points | None = None,
    *,
    settings: TrackerSettings,
) -> tuple[Points, BoolArray]:
    """Return where ``points`` of ``source`` are in ``target``, and which of them were found."""
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        points,
        None if guess is None else guess.copy(),
        winSize=(settings.window, settings.window),
        maxLevel=settings.levels,
        criteria=CRITERIA,
        flags=0 if guess is None else cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return moved, np.asarray(status.ravel() > 0)


def as_bright(image: Image, other: Image) -> Image:
    """Return ``image`` as bright as ``other``: Lucas-Kanade takes a change of light for motion."""
    gain = float(other[::8, ::8].mean()) / max(float(image[::8, ::8].mean()), 1.0)
    if abs(gain - 1.0) < NOTICEABLE_GAIN:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), dtype=np.uint8)
