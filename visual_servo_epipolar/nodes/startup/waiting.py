"""Messages that wait in DDS for this process, without an executor."""

from rclpy.exceptions import InvalidHandle
from rclpy.subscription import Subscription

WITH_INFO = Subscription.CallbackType.WithMessageInfo


def hand_out(subscription: Subscription) -> bool:
    """Call back for the next message that waits, and return whether there was one."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:  # another callback has just destroyed it
        return False
    if taken is None:
        return False
    with_info = subscription._callback_type is WITH_INFO
    subscription.callback(*taken if with_info else taken[:1])
    return True
