"""Versions of what computes: another numpy or OpenCV may round the last digits otherwise."""

from functools import cache
import platform

import cv2
import numpy as np

from visual_servo_epipolar import __version__

PACKAGE = 'visual_servo_epipolar'


@cache
def installed() -> dict[str, str]:
    """Return the versions of this package, of Python, numpy and OpenCV, by name."""
    # Asked of the modules themselves: apt's cv2 has no metadata that pip could see.
    return {
        PACKAGE: __version__,
        'Python': platform.python_version(),
        'numpy': np.__version__,
        'OpenCV': str(cv2.__version__),
    }
