"""A view that repeats itself while the robot is told to drive: a camera that hangs."""

from sensor_msgs.msg import PointCloud2

from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import read


class StillView:
    """
    For how long images have been the very same while the robot was told to drive.

    A driver that stamps its last image anew for ever looks alive by its stamps. A robot that
    stands proves nothing: without noise, its view does not change.
    """

    def __init__(self) -> None:
        self._stamp_ns, self._still_s = 0, 0.0

    def look(self, message: PointCloud2, *, told_to_drive: bool) -> None:
        """Take the next tracks, and whether the robot has been told to drive since the last."""
        before_ns, self._stamp_ns = self._stamp_ns, read.stamp_ns(message.header)
        if not read.repeats(message):
            self._still_s = 0.0
        elif told_to_drive:
            self._still_s += seconds_between(before_ns, self._stamp_ns)

    def trouble(self, timeout: float) -> str:
        """Return that the view has stood still for longer than ``timeout`` [s]; or ''."""
        if self._still_s <= timeout:
            return ''
        return (
            f'the images have shown the very same for {self._still_s:.1f} s of driving: the '
            'camera hangs, or the wheels do not turn; restart its driver'
        )
