"""Life cycles of managed nodes: transitions by id and label, as `ros2 lifecycle set` asks for."""

import gc
from typing import Any

from bench import Bench
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import psutil

CYCLES, HUNDREDS, MB = 100, 4, 2**20

IDS = {
    'configure': Transition.TRANSITION_CONFIGURE,
    'cleanup': Transition.TRANSITION_CLEANUP,
    'activate': Transition.TRANSITION_ACTIVATE,
    'deactivate': Transition.TRANSITION_DEACTIVATE,
}


def asked(number: int = 0, label: str = '') -> Any:
    """Return the request for a transition."""
    request = ChangeState.Request()
    request.transition.id, request.transition.label = number, label
    return request


def led(node: Any, number: int, label: str = '') -> bool:
    """Ask a node for a transition in this process; return whether it took place."""
    (service,) = (it for it in node.services if it.srv_name.endswith('/change_state'))
    return bool(service.callback(asked(number, label), ChangeState.Response()).success)


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
    return {kind: len(list(getattr(node, kind))) for kind in kinds}


def assert_cycles_leave_nothing(bench: Bench, node: Any) -> None:
    """Lead a node through its whole life again and again: it keeps nothing of it."""
    process, before, watched = psutil.Process(), entities(node), []
    for _ in range(HUNDREDS):
        for _ in range(CYCLES):
            node.trigger_configure()
            node.trigger_activate()
            node.trigger_deactivate()
            node.trigger_cleanup()
            bench.executor.spin_once(timeout_sec=0.0)
            assert entities(node) == before
        watched.append((process.memory_info().rss, process.num_fds(), process.num_threads()))
        assert watched[-1][1:] == watched[0][1:]
        # What leaks grows in every hundred; the first one fills the pools of the allocator.
        if len(watched) > 1 and watched[-1][0] - watched[-2][0] < 1 * MB:
            return
    raise AssertionError(f'memory grows: {[rss / MB for rss, *_ in watched]} MB')


def assert_gone_at_once(bench: Bench, node: Any) -> None:
    """Destroy a node: its name is gone, before garbage is collected."""
    name = node.get_name()
    gc.disable()
    try:
        bench.remove(node)
        assert name not in bench.probe.get_node_names()
    finally:
        gc.enable()
