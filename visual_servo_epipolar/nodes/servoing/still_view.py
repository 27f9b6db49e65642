"""A view that stands still while the robot is told to drive: a camera that hangs."""

import numpy as np
from sensor_msgs.msg import PointCloud2

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import read

# Features of the same image again: noise alone moves those of a real camera by 0.03 px, and the
# slowest drive by as much.
STILL_PX = 1e-3


class StillView:
    """
    For how long features have not moved at all while the robot was told to drive.

    A driver that stamps its last image anew for ever looks alive by its stamps. A robot that
    stands proves nothing: without noise, its view does not move.
    """

    def __init__(self) -> None:
        self._pixels: FloatArray = np.empty((0, 2))
        self._stamp_ns, self._still_s = 0, 0.0

    def look(self, message: PointCloud2, *, told_to_drive: bool) -> None:
        """Take the next tracks, and whether the robot has been told to drive since the last."""
        try:
            pixels = read.features(message).current
        except ValueError:  # told of where they are used
            return
        before_ns, self._stamp_ns = self._stamp_ns, read.stamp_ns(message.header)
        if self._has_moved(pixels):
            self._still_s = 0.0
        elif told_to_drive:
            self._still_s += seconds_between(before_ns, self._stamp_ns)
        self._pixels = pixels

    def trouble(self, timeout: float) -> str:
        """Return that the view has stood still for longer than ``timeout`` [s]; or ''."""
        if self._still_s <= timeout:
            return ''
        return (
            f'the images have shown the very same for {self._still_s:.1f} s of driving: the '
            'camera hangs, or the wheels do not turn; restart its driver'
        )

    def _has_moved(self, pixels: FloatArray) -> bool:
        if not len(pixels) or pixels.shape != self._pixels.shape:
            return True
        return bool(np.abs(pixels - self._pixels).max() > STILL_PX)
