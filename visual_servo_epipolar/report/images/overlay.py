"""
Overlay of features on an image, current and desired, after Fig. 19 of the paper.

Actual features are red crosses, desired ones green circles, with the epipolar lines on which the
first should lie. Used offline for the video and live by the tracker, hence fast.
"""

import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.report.images.drawing import (
    BGR,
    bgr,
    draw_label,
    draw_lines,
    draw_text,
    fixed_point,
    SHIFT,
    text_size,
)
from visual_servo_epipolar.report.style import INK

RED: BGR = (60, 50, 255)
GREEN: BGR = (70, 225, 60)
FLOW: BGR = (90, 230, 255)
LINE: BGR = (255, 190, 70)
DARK = bgr(INK)
EPIPOLE = '#FF50FF'

CROSS = np.array([((-1.0, -1.0), (1.0, 1.0)), ((-1.0, 1.0), (1.0, -1.0))])
MAX_EPIPOLAR_LINES = 10  # more hide the picture


def draw_overlay(
    image: Image,
    current: FloatArray,
    desired: FloatArray,
    *,
    header: str = '',
    colour: str = INK,
    epipole_current: float | None = None,
    horizon: float | None = None,
    fundamental: FloatArray | None = None,
) -> Image:
    """
    Return a colour picture, BGR, of the features drawn over a grey ``image``, shape (H, W).

    ``current`` and ``desired`` pixels, (N, 2), are the same features row by row.
    The ``header`` stands on its ``colour``, '#RRGGBB'. ``epipole_current`` is the abscissa of the
    epipole from the left border, drawn in the row ``horizon`` if it lies in the image. With
    ``fundamental``, F such that p_desired^T F p_current = 0, a few epipolar lines are drawn.
    """
    errors = np.linalg.norm(current - desired, axis=1)
    picture: Image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    unit = _unit(picture)
    if fundamental is not None:
        _draw_epipolar_lines(picture, fundamental, desired, unit)
    _draw_features(picture, current, desired, unit)
    if epipole_current is not None and 0.0 <= epipole_current < image.shape[1]:
        row = 0.5 * image.shape[0] if horizon is None else horizon
        _draw_epipole(picture, np.array([epipole_current, row]), unit)
    _draw_header(picture, header, colour, errors, unit)
    return picture


def epipolar_segments(lines: FloatArray, width: int, height: int) -> FloatArray:
    """
    Return the two ends of each line (a, b, c), a u + b v + c = 0, that spans the picture.

    ``lines`` has shape (N, 3); the result (M, 2, 2) leaves out those that miss the picture, and
    those at infinity.
    """
    centre, reach = np.array([0.5 * width, 0.5 * height]), 0.5 * math.hypot(width, height)
    normal, norm = lines[:, :2], np.linalg.norm(lines[:, :2], axis=1)
    offset = normal @ centre + lines[:, 2]
    visible = np.abs(offset) < reach * norm
    normal, offset = normal[visible] / norm[visible, None], offset[visible] / norm[visible]
    foot = centre - offset[:, None] * normal
    along = reach * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    return np.stack([foot - along, foot + along], axis=1)


def _unit(image: Image) -> float:
    """Return the size of things: 1 at 1280x1024, and not so small as to be lost."""
    height, width = image.shape[:2]
    return float(max(0.6, min(width / 1280.0, height / 1024.0)))


def _draw_epipolar_lines(
    picture: Image, fundamental: FloatArray, desired: FloatArray, unit: float
) -> None:
    step = -(-len(desired) // MAX_EPIPOLAR_LINES) or 1
    points = np.column_stack([desired[::step], np.ones(len(desired[::step]))])
    height, width = picture.shape[:2]
    # p_d^T F p_a = 0: in the current image the line of p_d is l = F^T p_d.
    segments = epipolar_segments(points @ np.asarray(fundamental), width, height)
    lines = picture.copy()
    draw_lines(lines, segments, LINE, max(1, round(1.6 * unit)))
    cv2.addWeighted(lines, 0.5, picture, 0.5, 0.0, dst=picture)


def _draw_features(picture: Image, current: FloatArray, desired: FloatArray, unit: float) -> None:
    thin, bold = max(1, round(1.2 * unit)), max(2, round(2.0 * unit))
    draw_lines(picture, np.stack([current, desired], axis=1), FLOW, thin)
    # Each mark has a dark rim that keeps it apart from any texture; a rim need not be smooth,
    # which saves half the time.
    radius = round(9.0 * unit * (1 << SHIFT))
    centres = fixed_point(desired).tolist()
    for at in centres:
        cv2.circle(picture, at, radius, DARK, bold + 2, cv2.LINE_8, SHIFT)
    for at in centres:
        for grown in range(bold):  # OpenCV is slow at thick circles, not at two thin ones
            cv2.circle(picture, at, radius + (grown << SHIFT), GREEN, 1, cv2.LINE_AA, SHIFT)
    crosses = (current[:, None, None] + 8.0 * unit * CROSS).reshape(-1, 2, 2)
    draw_lines(picture, crosses, DARK, bold + 2, smooth=False)
    draw_lines(picture, crosses, RED, bold)


def _draw_epipole(picture: Image, at: FloatArray, unit: float) -> None:
    arm = 18.0 * unit
    diamond = at + arm * np.array([[(-1, 0), (0, -1), (1, 0), (0, 1)]])
    bars = at + arm * np.array([((0, -2), (0, 2)), ((-1, 0), (1, 0))])
    for colour, width in ((DARK, 2), (bgr(EPIPOLE), 0)):
        draw_lines(picture, diamond, colour, round(2.0 * unit) + width, closed=True)
        draw_lines(picture, bars, colour, max(1, round(unit)) + width)
    size = 13.0 * unit
    right, label = at[0] + 1.4 * arm, text_size('epipole', size)[0] + 1.4 * size
    left = right if right + label < picture.shape[1] else at[0] - 1.4 * arm - label
    draw_label(picture, 'epipole', (left, at[1] - 1.5 * arm), size, EPIPOLE)


def _draw_header(
    picture: Image, header: str, colour: str, errors: FloatArray, unit: float
) -> None:
    size, band = 16.0 * unit, round(46.0 * unit)
    picture[:band] //= 5
    middle, left = 0.5 * band, 14.0 * unit
    if header:
        left += draw_label(picture, header, (left, middle), size, colour)
    count = f'{len(errors)} features' + (f', {np.median(errors):.1f} px' if len(errors) else '')
    right = picture.shape[1] - text_size(count, size)[0] - 14.0 * unit
    draw_text(picture, count, (right, middle), size, (255, 255, 255))
    key = (('x current', RED), ('o desired', GREEN))
    left += 24.0 * unit
    for text, shade in key:
        if left + text_size(text, size)[0] < right - size:
            left += draw_text(picture, text, (left, middle), size, shade) + 20.0 * unit
