"""Life cycles of managed nodes: transitions by id and label, as `ros2 lifecycle set` asks for."""

from typing import Any

from bench import Bench
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

IDS = {
    'configure': Transition.TRANSITION_CONFIGURE,
    'cleanup': Transition.TRANSITION_CLEANUP,
    'activate': Transition.TRANSITION_ACTIVATE,
    'deactivate': Transition.TRANSITION_DEACTIVATE,
}
PRIMARY = {'unconfigured', 'inactive', 'active', 'finalized'}


def asked(number: int = 0, label: str = '') -> Any:
    """Return the request for a transition."""
    request = ChangeState.Request()
    request.transition.id, request.transition.label = number, label
    return request


def change(bench: Bench, node: Any, number: int = 0, label: str = '') -> bool:
    """Ask a node for a transition over the wire; return whether it took place."""
    request = asked(number, label)
    return bool(bench.call(f'{node.get_name()}/change_state', ChangeState, request).success)


def go(bench: Bench, node: Any, *names: str) -> str:
    """Lead a node through transitions that must take place; return its state."""
    for name in names:
        assert change(bench, node, IDS[name]), f'{name} of a node that is {node.state}'
    answer = bench.call(f'{node.get_name()}/get_state', GetState)
    return str(answer.current_state.label)


def entities(node: Any) -> dict[str, int]:
    """Return how many entities of each kind a node has."""
    kinds = ('publishers', 'subscriptions', 'timers', 'services', 'clients', 'waitables')
    counts = {kind: len(list(getattr(node, kind))) for kind in kinds}
    return {**counts, 'managed': len(node._managed_entities)}
