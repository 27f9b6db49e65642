"""Variety of light among photographs of one pose: which is like another, which may go."""

from collections.abc import Sequence
from itertools import combinations

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image

ALIKE = 0.9  # correlation above which two photographs are of one light
SIZE = (64, 48)  # to which photographs are reduced: light is seen, a millimetre is not [px]
DARK_GREY = 8.0  # added to grey levels, of which logarithms are taken: noise in the dark is none


def superfluous(images: Sequence[Image], most: int) -> int | None:
    """
    Return which of ``images`` of one pose tells least of other light, None if all may stay.

    Images are uint8 of shape (H, W). The first always stays; the last, new, goes if one is ALIKE.
    Where there are more than ``most``, the older of the two most alike goes.
    """
    small = np.array([_reduced(image) for image in images])
    correlation = small @ small.T
    newest = len(images) - 1
    if newest == 0:
        return None
    if most == 1 or correlation[newest, :newest].max() > ALIKE:
        return newest
    if len(images) <= most:
        return None
    older, newer = max(combinations(range(len(images)), 2), key=lambda pair: correlation[pair])
    return older or newer


def _reduced(image: Image) -> FloatArray:
    """Return the logarithms of ``image`` reduced to SIZE, zero mean and unit norm, flat."""
    small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA).ravel().astype(np.float64)
    small = np.log(small + DARK_GREY)
    small -= small.mean()
    return np.asarray(small / max(float(np.linalg.norm(small)), 1e-9))
