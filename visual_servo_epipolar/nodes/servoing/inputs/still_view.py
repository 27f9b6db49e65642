"""Views that prove no time passing: of a camera that hangs, or of another time of the run."""

from sensor_msgs.msg import PointCloud2

from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import read

DISTRUST_S = 2.0  # after an image of another time: where one comes, others do that are not known
LAST = 1  # how many images ago the last one came


class FrozenImageCheck:
    """
    For how long images have been the very same while the robot was told to drive.

    A driver that stamps its last image anew for ever looks alive by its stamps. A robot that
    stands proves nothing: without noise, its view does not change. An image that came before the
    last one, and comes again with a new stamp, is of another time: no robot drives back to it to
    the last bit. A simulator whose noise repeats may show it to one that stands, or has just
    started.
    """

    def __init__(self) -> None:
        self._stamp_ns, self._still_s = 0, 0.0
        self._drives = False  # whether it was told to drive before the last image, too
        self._old_ns: int | None = None  # stamp of the last image of another time

    def look(self, message: PointCloud2, *, told_to_drive: bool) -> None:
        """Take the next tracks, and whether the robot has been told to drive since the last."""
        before_ns, self._stamp_ns = self._stamp_ns, read.stamp_ns(message.header)
        if not read.repeats(message):
            self._still_s = 0.0
        elif told_to_drive:
            self._still_s += seconds_between(before_ns, self._stamp_ns)
        if read.back(message) > LAST and (self._drives and told_to_drive or self._distrusts):
            self._old_ns = self._stamp_ns
        self._drives = told_to_drive

    @property
    def _distrusts(self) -> bool:
        if self._old_ns is None:
            return False
        return abs(seconds_between(self._old_ns, self._stamp_ns)) <= DISTRUST_S

    def trouble(self, timeout: float) -> str:
        """
        Return why the view proves nothing, or ''.

        It has stood still for longer than ``timeout`` [s], or was of another time a while ago.
        """
        if self._still_s > timeout:
            return (
                f'the images have shown the very same for {self._still_s:.1f} s of driving: the '
                'camera hangs, or the wheels do not turn; restart its driver'
            )
        if self._distrusts:
            return (
                'images of another time of the run come with new stamps: a buffer is played '
                'again, a driver mixes its images up, or the wheels do not turn; restart it'
            )
        return ''
