"""Work through a plan: hand out what is missing, keep what comes back."""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed, Executor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.sweeping.chunk import work
from visual_servo_epipolar.sweeping.plan import Plan
from visual_servo_epipolar.sweeping.store import Store

Watch = Callable[[Sequence[dict[str, Any]]], None]


def drive(plan: Plan, store: Store, executor: Executor, *, workers: int, watch: Watch) -> None:
    """
    Do the runs of ``plan`` that ``store`` does not have yet, and keep each as it ends.

    ``watch`` is called after each chunk with its results.

    Raises
    ------
    VisualServoError
        If a worker process died; what had ended is kept.

    """
    chunks = plan.chunks(store.results.keys(), workers)
    try:
        futures = {executor.submit(work, plan, chunk): chunk for chunk in chunks}
        for future in as_completed(futures):
            results = future.result()
            store.add(futures.pop(future), results)
            watch(results)
    except BrokenProcessPool:
        raise VisualServoError(
            f'a worker process died (killed, or out of memory?); {len(store.results)} runs are '
            f'kept in {store.path}, and the same command goes on from there'
        ) from None
