"""Gates of a managed node: callbacks, topics and answers by state."""

from collections import deque
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecyclePublisher, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.errors import VisualServoError

Callback = Callable[..., Any]
CallbackT = TypeVar('CallbackT', bound=Callback)
REMEDIES = {
    'unconfigured': 'call ros2 lifecycle set {name} configure, then activate',
    'inactive': 'call ros2 lifecycle set {name} activate',
    'finalized': 'start it anew',
}


def in_every_state(callback: CallbackT) -> CallbackT:
    """Mark a callback that is called in every state, such as that which stops the robot."""
    callback.in_every_state = True  # type: ignore[attr-defined]
    return callback


def gate(callback: Callback, is_open: Callable[[], bool], otherwise: Callback) -> Callback:
    """Return a callback that calls ``otherwise`` while the gate is not open."""
    if getattr(callback, 'in_every_state', False):
        return callback

    @wraps(callback)  # rclpy looks at its signature
    def pass_on(*arguments: Any) -> Any:
        return callback(*arguments) if is_open() else otherwise(*arguments)

    return pass_on


class Mailbox:
    """Messages that came before a closed gate: latched ones, for they are not sent again."""

    def __init__(self, callback: Callback, profile: QoSProfile | int) -> None:
        latched = not isinstance(profile, int) and (
            profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        )
        depth = max(1, profile.depth) if latched else 0  # type: ignore[union-attr]
        self._callback = callback
        self._waiting: deque[tuple[Any, ...]] = deque(maxlen=depth)

    def keep(self, *message: Any) -> None:
        """Keep a message, the newest if there are too many; drop it where it is not latched."""
        self._waiting.append(message)

    def deliver(self) -> None:
        """Hand on what waits."""
        while self._waiting:
            self._callback(*self._waiting.popleft())


class ManagedPublisher(LifecyclePublisher):
    """Publisher, silent while inactive; the newest latched message goes out on activation."""

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


def remedy(node: Any) -> str:
    """Return in which state a node is, and how it becomes active."""
    name = node.get_fully_qualified_name()
    return f'{name} is {node.state}; {REMEDIES.get(node.state, "try again").format(name=name)}'


def answer_the_impossible(node: Any) -> None:
    """Let ``node`` refuse a transition that its state does not have (rclpy#1209), and live on."""
    for service in node.services:
        if service.srv_type is ChangeState:
            service.callback = _refusing(node, service.callback)


def _refusing(node: Any, change: Callback) -> Callback:
    def answer(request: Any, response: Any) -> Any:
        try:
            return change(request, response)
        except RuntimeError:  # RCLError
            wanted = request.transition.label or f'with the id {request.transition.id}'
            name = node.get_fully_qualified_name()
            node.get_logger().warning(f'{name} is {node.state}: there is no transition {wanted}')
            response.success = False
            return response

    return answer


def serve(
    node: Node, name: str, action: Callable[[], str], done: str = '', refused: str = ''
) -> None:
    """Serve ``name`` by an ``action`` that is marked ``in_every_state`` or not; see carry_out."""

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = carry_out(node, action, done, refused)
        return response

    always = getattr(action, 'in_every_state', False)
    node.create_service(Trigger, name, in_every_state(answer) if always else answer)


def carry_out(
    node: Node, action: Callable[[], str], done: str = '', refused: str = ''
) -> tuple[bool, str]:
    """
    Return whether an ``action`` was done, and the text that it returns, or raises as a refusal.

    The text is logged within ``done`` or ``refused``, where there is one.
    """
    success = True
    try:
        text = action()
    except (VisualServoError, ValueError) as error:
        success, text = False, str(error)
    if success and done:
        node.get_logger().info(done.format(text))
    elif not success and refused:
        node.get_logger().warning(refused.format(text))
    return success, text
