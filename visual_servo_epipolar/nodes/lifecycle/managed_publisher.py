"""Publisher of a managed node: silent while that is inactive."""

from typing import Any

from rclpy.lifecycle import LifecyclePublisher
from rclpy.lifecycle.managed_entity import TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleState
from rclpy.qos import DurabilityPolicy


class ManagedPublisher(LifecyclePublisher):
    """
    Publisher that is silent while the node is inactive.

    The newest message of a latched topic goes out when the node is activated: those who come late
    count on it. Others are dropped.
    """

    _unsaid: Any = None

    def publish(self, msg: Any) -> None:
        """Publish a message, or keep it if the topic is latched."""
        if self.is_activated:
            super().publish(msg)
        elif self.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self._unsaid = msg

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Say what was kept."""
        outcome = super().on_activate(state)
        unsaid, self._unsaid = self._unsaid, None
        if unsaid is not None:
            super().publish(unsaid)
        return outcome
