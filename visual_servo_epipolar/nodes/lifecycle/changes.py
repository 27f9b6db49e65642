"""Changes of state: what to do about the state of a node, and requests that are impossible."""

from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation

REMEDIES = {
    'unconfigured': 'call ros2 lifecycle set {name} configure, then activate',
    'inactive': 'call ros2 lifecycle set {name} activate',
    'finalized': 'start it anew',
}


def remedy(node: Any) -> str:
    """Return in which state a node is, and how it becomes active."""
    name = node.get_fully_qualified_name()
    return f'{name} is {node.state}; {REMEDIES.get(node.state, "try again").format(name=name)}'


def answer_the_impossible(node: Any) -> None:
    """
    Let ``node`` answer a request for a transition that its state does not have, and live on.

    rclpy would raise RCLError out of spin (rclpy#1209), and whoever asked would wait for ever.
    """
    service = getattr(node, '_service_change_state', None)
    if service is None:  # without its interface nobody can ask
        return
    change = service.callback

    def answer(request: Any, response: Any) -> Any:
        try:
            return change(request, response)
        except rclpy_implementation.RCLError:
            wanted = request.transition.label or f'with the id {request.transition.id}'
            name = node.get_fully_qualified_name()
            node.get_logger().warning(f'{name} is {node.state}: there is no transition {wanted}')
            response.success = False
            return response

    service.callback = answer
