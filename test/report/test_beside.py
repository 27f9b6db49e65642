"""Figures drawn by another process: the same files, drawn here where it dies, errors come back."""

from dataclasses import replace
import multiprocessing
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.processes import THREADS
from visual_servo_epipolar.report.beside import Draughtsman
from visual_servo_epipolar.report.figures import save_all
from visual_servo_epipolar.report.run_file import RunFile, save_run
from visual_servo_epipolar.threads import ONE_THREAD


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def drawn_here(log: RunLog, tmp_path: Path) -> dict[str, bytes]:
    (tmp_path / 'here').mkdir()
    save_all(log, tmp_path / 'here')
    return contents(tmp_path / 'here')


@pytest.fixture
def there(tmp_path: Path) -> Path:
    folder = tmp_path / 'there'
    folder.mkdir()
    return folder


def test_its_figures_are_those_drawn_here(log: RunLog, there: Path, drawn_here) -> None:
    with Draughtsman() as draughtsman:
        written = draughtsman.draw(log, there)
    assert contents(there) == drawn_here
    assert sorted(written) == [there / 'signals.png', there / 'trajectory.png']
    assert not multiprocessing.active_children()


def test_where_it_was_killed_figures_are_drawn_here(log: RunLog, there: Path, drawn_here) -> None:
    with Draughtsman() as draughtsman:
        (process,) = multiprocessing.active_children()
        os.kill(process.pid, signal.SIGKILL)
        process.join(30.0)
        draughtsman.draw(log, there)
    assert contents(there) == drawn_here


def test_a_run_that_breaks_leaves_no_process() -> None:
    with pytest.raises(KeyboardInterrupt), Draughtsman():
        raise KeyboardInterrupt
    assert not multiprocessing.active_children()


def test_what_cannot_be_drawn_is_told_as_here(log: RunLog, there: Path) -> None:
    with pytest.raises(ValueError, match='must have samples'), Draughtsman() as draughtsman:
        draughtsman.draw(replace(log, samples=()), there)
    with pytest.raises(OSError), Draughtsman() as draughtsman:
        draughtsman.draw(log, there / 'that is not there')


# In a process of its own, whose copies have one thread: there each figure has a process.
FAILED = """
import os
from pathlib import Path
import sys

from visual_servo_epipolar.processes import is_forked, context
from visual_servo_epipolar.report import figures
from visual_servo_epipolar.report.beside import Draughtsman
from visual_servo_epipolar.report.run_file import load_run

log, folder, failing = load_run(Path(sys.argv[1])).log, Path(sys.argv[1]), figures.save_one


def save_one(name, *others):
    (folder / f'{name}.{os.getpid()}').touch()
    if len(list(folder.glob('trajectory.png.*'))) == 1 and name == 'trajectory.png':
        raise MemoryError  # the first time it is drawn
    return failing(name, *others)


figures.save_one = save_one
assert is_forked(context())
with Draughtsman() as draughtsman:
    assert len(draughtsman.draw(log, folder)) == 2
"""


@pytest.mark.long
@pytest.mark.skipif(not THREADS.is_dir(), reason='nothing is forked here')
def test_a_figure_that_a_copy_fails_to_draw_is_drawn_again(
    log: RunLog, there: Path, drawn_here
) -> None:
    save_run(RunFile(log, {}, {}), there)
    environment = {**os.environ, **ONE_THREAD}
    given = [sys.executable, '-c', FAILED, str(there)]
    subprocess.run(given, env=environment, check=True, timeout=120.0)
    tries = [path.suffixes[-1] for path in there.glob('*.png.*')]
    assert len(tries) == 3
    assert len(set(tries)) == 2  # the copy, and the process it was made by
    assert {name: (there / name).read_bytes() for name in drawn_here} == drawn_here
