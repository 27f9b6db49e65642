"""Figures drawn by another process: the same files, drawn here where it dies, errors come back."""

from dataclasses import replace
import multiprocessing
import os
from pathlib import Path
import signal

import pytest

from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.report.beside import Draughtsman
from visual_servo_epipolar.report.figures import save_all


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
