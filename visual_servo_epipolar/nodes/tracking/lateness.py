"""Lateness: tracks of images that are old when they come."""

from rclpy.node import Node

from visual_servo_epipolar.core.stamps import OTHER_CLOCK_S, seconds_between

BEHIND_S = 0.5  # age of an image at which its tracks come late
BEHIND_IMAGES = 3  # so many one after the other are no single match of the whole image


class Lateness:
    """Lateness of the tracks of ``node``, by the age of each image."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._late = 0  # images in a row whose tracks came late

    def age_s(self, stamp_ns: int) -> float | None:
        """Return the age of an image [s]; None in simulated time or where another clock stamps."""
        if self._node.get_parameter('use_sim_time').value:
            return None
        age_s = seconds_between(stamp_ns, self._node.get_clock().now().nanoseconds)
        return age_s if abs(age_s) < OTHER_CLOCK_S else None

    def complaint(self, age_s: float | None) -> str:
        """Count an image of this age, and return that tracks come late, and what to do, or ''."""
        self._late = self._late + 1 if age_s is not None and age_s >= BEHIND_S else 0
        if age_s is None or self._late < BEHIND_IMAGES:
            return ''
        return (
            f'the tracker falls behind: the newest image was {age_s:.1f} s old when its tracks '
            'came; send smaller images or fewer, or lower max_features'
        )
