"""Stop button: while it is pressed nothing drives; released, the robot stands until ~/start."""

from collections.abc import Callable

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from std_msgs.msg import Bool

from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.lifecycle.gates import in_every_state

# One of the two subscriptions fits; that the other does not is no news.
NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
PRESSED = 'the stop button is pressed; release it, then call ~/start'


class StopButton:
    """Stop button of the servo ``node``, a std_msgs/Bool; ``on_press`` is told why."""

    def __init__(self, node: Node, on_press: Callable[[str], None]) -> None:
        self._log, self._on_press = node.get_logger(), on_press
        self.pressed = False
        # Latched, so that a servo that is started in mid-press learns of it; and any other button.
        for profile in (qos.LATCHED, qos.IMAGES['best_effort']):
            node.create_subscription(
                Bool, 'stop_button', self._on_button, profile, event_callbacks=NO_EVENTS
            )

    @in_every_state
    def _on_button(self, message: Bool) -> None:
        was_pressed, self.pressed = self.pressed, bool(message.data)
        if self.pressed and not was_pressed:
            self._log.warning(PRESSED)
            self._on_press('the stop button is pressed')
        elif was_pressed and not self.pressed:
            self._log.info('the stop button is released; the robot stands until ~/start is called')
