"""Flicker: light that goes with the mains, through a shutter of its own time."""

import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.simulation.light.settings import LightSettings


def flicker(image: Image, settings: LightSettings, time: float, exposure: float) -> Image:
    """
    Return ``image``, shape (H, W), whose first row opens at ``time`` [s], as the light flickers.

    A shutter open for a whole period sees nothing of it; a shorter one, by ``exposure`` of the
    set time, takes what it meets: all rows alike, or bands where they are read out one by one.
    """
    depth, rate, shutter = settings.flicker, settings.flicker_rate, settings.shutter * exposure
    if depth == 0.0:
        return image
    seen = depth * np.sinc(rate * shutter)  # the mean of a wave over the shutter
    rows = len(image) if settings.readout else 1
    middle = time + 0.5 * shutter + settings.readout * np.arange(rows) / rows
    factors = (1.0 + seen * np.cos(2.0 * math.pi * rate * middle))[:, None]
    if rows == 1:
        return np.asarray(cv2.convertScaleAbs(image, alpha=float(factors[0, 0])), np.uint8)
    bands = np.broadcast_to(factors.astype(np.float32), image.shape)
    return np.asarray(cv2.multiply(image, bands, dtype=cv2.CV_8U), dtype=np.uint8)
