"""Priority of processes that work beside a run."""

from contextlib import suppress
import os


def work_beside() -> None:
    """Let this process run only where no other wants the core."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def hurry(pid: int | None) -> None:
    """Let the process ``pid`` run like any other again: somebody waits for it now."""
    if pid is not None:
        with suppress(OSError):  # it has died, or may not: then in the time that is left
            os.sched_setscheduler(pid, os.SCHED_OTHER, os.sched_param(0))
