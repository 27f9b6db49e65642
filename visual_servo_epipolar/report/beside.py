"""Figures of a run by a process of its own, which loads what draws them while the run lasts."""

from contextlib import AbstractContextManager
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.processes import begun, context, copied, hurry, may_fork, work_beside


class Draughtsman(AbstractContextManager['Draughtsman']):
    """
    A process that loads matplotlib beside the run, and then draws its figures on two cores.

    Where it dies the figures are drawn here: they are the same, only later.
    """

    def __init__(self) -> None:
        beside = context()
        there, self._here = beside.Pipe()
        self._process = begun(beside, 'draughtsman', _draw, (there,), ours=(self._here,))
        there.close()

    def __exit__(self, *_: object) -> None:
        self._here.close()
        self._process.kill()  # whatever it still loads or draws, nobody waits for it
        self._process.join()

    def draw(self, log: RunLog, folder: Path) -> list[Path]:
        """
        Write trajectory.png and signals.png into ``folder`` and return their paths.

        Raises what ``figures.save_all`` raises, or ImportError where it cannot be loaded.
        """
        hurry(self._process.pid)
        try:
            self._here.send((log, folder))
            answer = self._here.recv()
        except (EOFError, OSError):
            from visual_servo_epipolar.report import figures

            return figures.save_all(log, folder)
        if isinstance(answer, Exception):
            raise answer
        return [Path(path) for path in answer]


def _draw(there: Connection) -> None:
    """Draw the run that comes; an end without a word means that there is none."""
    work_beside()  # the run goes first
    try:
        from visual_servo_epipolar.report import figures  # loaded while the run lasts

        log, folder = there.recv()
        there.send(
            _draw_on_two_cores(log, folder) if may_fork() else figures.save_all(log, folder)
        )
    except (EOFError, BrokenPipeError):  # the parent's end is closed
        pass
    except (VisualServoError, ValueError, OSError, ImportError) as error:
        there.send(error)


def _draw_on_two_cores(log: RunLog, folder: Path) -> list[Path]:
    """Draw each figure on a core of its own: all but the first by copies of this process."""
    from visual_servo_epipolar.report import figures

    first, *others = figures.FIGURES
    waits = [copied(partial(figures.save_one, name, log, folder)) for name in others]
    try:
        written = [figures.save_one(first, log, folder)]
    finally:
        are_done = [wait() for wait in waits]
    for name, is_done in zip(others, are_done, strict=True):
        # What failed there is tried here, which tells why.
        written.append(folder / name if is_done else figures.save_one(name, log, folder))
    return written
