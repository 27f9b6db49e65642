"""Work through a plan: hand out what is missing, keep what comes back."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from visual_servo_epipolar.sweeping.plan import Chunk, Plan
from visual_servo_epipolar.sweeping.store import Store

PATIENCE_S = 10.0  # without a result, after which the workers are looked after

Results = list[dict[str, Any]]
Watch = Callable[[Sequence[dict[str, Any]]], None]


class Workers(Protocol):
    """Whoever does chunks: processes of this machine, or of a cluster; ``count`` at a time."""

    count: int

    def submit(self, plan: Plan, chunk: Chunk) -> 'Future[Results]':
        """Have ``chunk`` done by the function ``work`` on some worker."""
        ...

    def check(self) -> None:
        """Raise VisualServoError if nothing can be expected of the workers any more."""
        ...


def drive(plan: Plan, store: Store, workers: Workers, watch: Watch) -> None:
    """
    Do the runs of ``plan`` that ``store`` does not have yet, and keep each as its chunk ends.

    ``watch`` is called after each chunk with its results. What a worker or its loss raises comes
    out here; what had ended until then is kept.
    """
    ended: SimpleQueue[Future[Results]] = SimpleQueue()
    under_way: dict[Future[Results], Chunk] = {}
    for chunk in plan.chunks(store.results.keys(), workers.count):
        future = workers.submit(plan, chunk)
        under_way[future] = chunk
        future.add_done_callback(ended.put)
    while under_way:
        try:
            future = ended.get(timeout=PATIENCE_S)
        except Empty:
            workers.check()
            continue
        results = future.result()
        store.add(under_way.pop(future), results)
        watch(results)
