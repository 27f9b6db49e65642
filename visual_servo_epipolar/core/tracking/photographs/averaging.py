"""
Averaging: one photograph of several images taken at rest, with less noise than each.

Motion is seen in the images: a difference of two that gradients explain is motion, the rest is
noise, and what noise does not explain is a person who walks by.
"""

from collections.abc import Sequence

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.geometry.least_squares import deviation_of, linear_fit

STILL_PX = 0.1  # motion at the border of the image that blurs less than tracking errs
DEVIATIONS = 3.0  # beyond STILL_PX at which a motion is none of noise
SAMPLES = 20_000  # pixels of a difference that are looked at
CHANGED_DEVIATIONS, CHANGED_FLOOR = 6.0, 10.0  # of a pixel that has changed, plus grey levels
CHANGED_SHARE = 0.03  # of such pixels at which something moves in view
MOTIONS = 4  # of the columns below: shift along x and y, zoom, roll


def averaged(images: Sequence[Image]) -> Image:
    """Return the mean of ``images``, uint8 of shape (H, W) each, rounded."""
    if len(images) == 1:
        return images[0]
    total = np.zeros(images[0].shape, np.uint32)
    for image in images:
        total += image
    return ((total + len(images) // 2) // len(images)).astype(np.uint8)


def at_rest(images: Sequence[Image]) -> tuple[int, str]:
    """
    Return how many of ``images``, the first and those after it, show one view.

    And what the next one shows of motion, '' if there is none.
    """
    for count, image in enumerate(images[1:], 1):
        reason = unrest(images[0], image)
        if reason:
            return count, reason
    return len(images), ''


def unrest(first: Image, second: Image) -> str:
    """Return what moves from one image to another, in words; '' if that is noise and light."""
    if first.shape != second.shape:
        return 'their sizes differ'
    if min(first.shape) < 3:
        return ''  # no slopes: no photograph either
    difference, columns = _difference(first, second)
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-9)
    rows = columns / scale
    fit = linear_fit(rows, difference, ridge=1e-6 * len(rows))
    residual = np.abs(fit.residual)
    noise = deviation_of(float(np.median(residual)))
    errors = noise * np.sqrt(np.diag(fit.covariance())) / scale
    motion = _at_border((fit.solution / scale)[:MOTIONS])
    if motion > STILL_PX + DEVIATIONS * _at_border(errors[:MOTIONS]):
        return f'the view moves by {motion:.2g} px'
    share = float((residual > CHANGED_DEVIATIONS * noise + CHANGED_FLOOR).mean())
    return f'{share:.1%} of the view changes' if share > CHANGED_SHARE else ''


def _at_border(motion: FloatArray) -> float:
    """Return how far shift, zoom and roll, (4,), move a pixel at the border of the image [px]."""
    return float(np.hypot(*motion[:2]) + np.hypot(*motion[2:]))


def _difference(first: Image, second: Image) -> tuple[FloatArray, FloatArray]:
    """Return differences, (N,), of sampled pixels, and what explains them, (N, 6), see MOTIONS."""
    height, width = first.shape
    stride = max(int(np.sqrt(height * width / SAMPLES)), 1)
    rows, cols = np.arange(1, height - 1, stride), np.arange(1, width - 1, stride)
    mean = 0.5 * (first.astype(np.float32) + second)
    here = np.ix_(rows, cols)
    slope_x = 0.5 * (mean[np.ix_(rows, cols + 1)] - mean[np.ix_(rows, cols - 1)])
    slope_y = 0.5 * (mean[np.ix_(rows + 1, cols)] - mean[np.ix_(rows - 1, cols)])
    half = 0.5 * max(height, width)
    x = ((cols - 0.5 * (width - 1)) / half)[None, :]
    y = ((rows - 0.5 * (height - 1)) / half)[:, None]
    columns = [
        slope_x,
        slope_y,
        x * slope_x + y * slope_y,
        x * slope_y - y * slope_x,
        mean[here],
        np.ones_like(slope_x),
    ]
    difference = first[here].astype(np.float64) - second[here]
    return difference.ravel(), np.stack([item.ravel() for item in columns], axis=1)
