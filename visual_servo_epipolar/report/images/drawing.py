"""Text, labels and lines at fractions of a pixel, drawn into images by OpenCV."""

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.report.style import rgb, text_colour_on

BGR = tuple[int, int, int]

FONT = cv2.FONT_HERSHEY_SIMPLEX
SHIFT = 4  # OpenCV draws at sixteenths of a pixel
_FAR = 1 << 14  # pixels: beyond, fixed point coordinates would overflow


def bgr(colour: str) -> BGR:
    """Return '#RRGGBB' in OpenCV's order."""
    return rgb(colour)[::-1]


def fixed_point(points: FloatArray) -> NDArray[np.int32]:
    """Return ``points``, in pixels, as the integers that OpenCV draws with ``shift=SHIFT``."""
    return np.rint(np.clip(points, -_FAR, _FAR) * (1 << SHIFT)).astype(np.int32)


def draw_lines(
    image: Image,
    lines: FloatArray,
    colour: BGR,
    thickness: int = 1,
    *,
    closed: bool = False,
    smooth: bool = True,
) -> None:
    """Draw polylines of as many points each, shape (M, N, 2) in pixels, into ``image``."""
    if len(lines):
        kind = cv2.LINE_AA if smooth else cv2.LINE_8
        cv2.polylines(image, list(fixed_point(lines)), closed, colour, thickness, kind, SHIFT)


def fill(image: Image, corners: FloatArray, colour: BGR) -> None:
    """Fill the convex polygon ``corners``, shape (N, 2) in pixels."""
    cv2.fillConvexPoly(image, fixed_point(corners), colour, cv2.LINE_AA, SHIFT)


def text_size(text: str, size: float) -> tuple[int, int]:
    """Return width and height in pixels of ``text`` with capitals about ``size`` pixels high."""
    (width, height), _ = cv2.getTextSize(text, FONT, _scale(size), _thickness(size))
    return width, height


def draw_text(image: Image, text: str, at: tuple[float, float], size: float, colour: BGR) -> int:
    """
    Write ``text`` from the left at ``at``, the middle of its capitals; return its width.

    ``size`` is the height of the capitals in pixels. Characters beyond ASCII are not drawn.
    """
    origin = round(at[0]), round(at[1] + 0.5 * size)
    cv2.putText(image, text, origin, FONT, _scale(size), colour, _thickness(size), cv2.LINE_AA)
    return text_size(text, size)[0]


def draw_label(image: Image, text: str, at: tuple[float, float], size: float, colour: str) -> int:
    """Write ``text`` on a plate of ``colour`` that begins at ``at``; return the plate's width."""
    pad = round(0.7 * size)
    width = text_size(text, size)[0] + 2 * pad
    left, top = round(at[0]), round(at[1] - size)
    cv2.rectangle(image, (left, top), (left + width, round(at[1] + size)), bgr(colour), -1)
    draw_text(image, text, (left + pad, at[1]), size, bgr(text_colour_on(colour)))
    return width


def _scale(size: float) -> float:
    return size / 21.0  # the capitals of the Hershey font are 21 pixels high at scale 1


def _thickness(size: float) -> int:
    return max(1, round(size / 10.0))
