"""The photograph of the tracker as a file."""

from pathlib import Path

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, Image


def read_photograph(path: str) -> Image:
    """Read the photograph that a parameter names, or raise ValueError."""
    encoded = np.fromfile(path, np.uint8) if Path(path).is_file() else np.empty(0, np.uint8)
    image = cv2.imdecode(encoded, cv2.IMREAD_GRAYSCALE) if encoded.size else None
    if image is None:
        raise ValueError(f'desired_image must be a readable image file, got {path!r}')
    return as_gray(image)
