"""A base that can break: the simulated Pioneer, of which a wheel may be stuck."""

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode
from visual_servo_epipolar.simulation.bases.pioneer import Pioneer
from visual_servo_epipolar.simulation.bases.simulated_base import SimulatedBase


class BreakablePioneer(Pioneer):
    """``grip`` is what is left of the left and of the right wheel's motion: 0 is stuck."""

    grip = (1.0, 1.0)

    def _true(self, linear: float, angular: float) -> tuple[float, float]:
        linear, angular = super()._true(linear, angular)
        half = 0.5 * self.settings.track
        left, right = self.grip
        left, right = left * (linear - half * angular), right * (linear + half * angular)
        return 0.5 * (left + right), (right - left) / self.settings.track


class BreakableUnicycleNode(UnicycleNode):
    """The node of the base, with one that can break."""

    def break_wheels(self, left: float, right: float) -> None:
        """Leave of each wheel's motion this part."""
        assert isinstance(self._base, BreakablePioneer)
        self._base.grip = left, right

    def _new_base(self) -> SimulatedBase:
        start = Pose.from_start(*self._settings.start)
        now_ns = int(self._steady.now().nanoseconds)
        return BreakablePioneer(
            self._base_settings, start, seed=self._settings.seed, now_ns=now_ns
        )


# The name of the executable stays.
BreakableUnicycleNode.__name__ = UnicycleNode.__name__
