"""Driver of a sweep: hands out the missing runs of a plan and stores their results."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from visual_servo_epipolar.sweeping.plan import Chunk, SweepPlan
from visual_servo_epipolar.sweeping.store import Store

PATIENCE_S = 10.0  # without a result, after which the workers are checked

Results = list[dict[str, Any]]
Watch = Callable[[Sequence[dict[str, Any]]], None]


class Workers(Protocol):
    """Workers: processes of this machine, or of a cluster; ``count`` chunks at a time."""

    count: int

    def submit(self, plan: SweepPlan, chunk: Chunk) -> 'Future[Results]':
        """Have ``chunk`` done by the function ``work`` on some worker."""
        ...

    def check(self) -> None:
        """Raise VisualServoError if the workers can no longer answer."""
        ...


def drive(plan: SweepPlan, store: Store, workers: Workers, watch: Watch) -> None:
    """
    Do the runs of ``plan`` that ``store`` does not have yet, and keep each as its chunk ends.

    ``watch`` is called after each chunk with its results. What a worker or its loss raises comes
    out here; the results until then are kept.
    """
    completed: SimpleQueue[Future[Results]] = SimpleQueue()
    pending: dict[Future[Results], Chunk] = {}
    for chunk in plan.chunks(store.results.keys(), workers.count):
        future = workers.submit(plan, chunk)
        pending[future] = chunk
        future.add_done_callback(completed.put)
    while pending:
        try:
            future = completed.get(timeout=PATIENCE_S)
        except Empty:
            workers.check()
            continue
        results = future.result()
        store.add(pending.pop(future), results)
        watch(results)
