"""Dask: the same results as here, and one clear line when the cluster cannot."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
import json
import os
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

import pytest
from sweeps import BRIEF, plan_of

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.sweeping import store as store_module
from visual_servo_epipolar.sweeping import workers as cluster
from visual_servo_epipolar.sweeping.store import drive, Store
from visual_servo_epipolar.sweeping.workers import cluster_workers, local_workers

distributed = pytest.importorskip('distributed')

ROOT = Path(__file__).parents[2]
START_SEC = 30.0
MANY = 4000  # runs, never to end before something happens to them
HIDDEN = "import sys; sys.modules['visual_servo_epipolar'] = None"
OTHER = (
    'from visual_servo_epipolar.sweeping import provenance; provenance.digest = lambda: "other"'
)
SWEEP = ('sweep', '--region', 'front', '--runs', '4', '--scenario')


class Cluster:
    """A scheduler and workers, each a process of its own on this machine."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder = stack, folder
        self.file = folder / 'scheduler.json'
        # The scheduler does not have this package, as on a cluster that serves many.
        self.scheduler = self._start(
            HIDDEN, 'scheduler', '--port', '0', '--scheduler-file', str(self.file)
        )
        self._until(self._is_described, 'the scheduler')
        self.address = json.loads(self.file.read_text())['address']

    def worker(self, preparation: str = '') -> 'subprocess.Popen[bytes]':
        """Start a worker that runs ``preparation`` first, and return once it is registered."""
        before = self._workers()
        options = ('--no-nanny', '--nthreads', '1', '--local-directory', str(self._folder))
        started = self._start(preparation, 'worker', self.address, *options)
        self._until(lambda: self._workers() > before, 'the worker')
        return started

    def stop(self, process: 'subprocess.Popen[bytes]') -> None:
        """End a worker and return once the scheduler knows."""
        before = self._workers()
        process.kill()
        self._until(lambda: self._workers() < before, 'the end of the worker')

    def _start(self, preparation: str, name: str, *options: str) -> 'subprocess.Popen[bytes]':
        code = f'{preparation}\nfrom distributed.cli.dask_{name} import main; main()'
        process = subprocess.Popen(
            [sys.executable, '-c', code, '--host', '127.0.0.1', '--no-dashboard', *options],
            env={**os.environ, 'PYTHONPATH': str(ROOT)},
            stderr=self._stack.enter_context((self._folder / f'{name}.log').open('a')),
        )
        self._stack.callback(process.wait, START_SEC)
        self._stack.callback(process.kill)
        return process

    def _is_described(self) -> bool:
        with suppress(subprocess.TimeoutExpired):
            pytest.fail(f'the scheduler ended with {self.scheduler.wait(0.05)}')
        with suppress(OSError, ValueError):  # not there yet, or not yet complete
            return 'address' in json.loads(self.file.read_text())
        return False

    def _workers(self) -> int:
        with distributed.Client(self.address, set_as_default=False) as client:
            return len(client.nthreads())

    @staticmethod
    def _until(condition: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + START_SEC
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f'waited {START_SEC:g} s for {what}')


@pytest.fixture
def real(tmp_path: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(stack, tmp_path)


def swept_on(address: str, folder: Path, runs: int = 4, watch: Any = len) -> dict[Any, Any]:
    plan = plan_of(runs)
    with Store(folder, plan) as store, cluster_workers(address) as workers:
        drive(plan, store, workers, watch)
        return store.results


def swept_here(folder: Path) -> dict[Any, Any]:
    plan = plan_of()
    with Store(folder, plan) as store, local_workers(1) as workers:
        drive(plan, store, workers, len)
        return store.results


def test_a_real_cluster_gives_the_results_of_processes(tmp_path: Path, real: Cluster) -> None:
    real.worker()
    assert swept_on(real.address, tmp_path / 'cluster') == swept_here(tmp_path / 'here')


@pytest.mark.long
def test_a_cluster_is_refused_unless_it_can_work(tmp_path, real: Cluster, monkeypatch) -> None:
    monkeypatch.setattr(cluster, 'CONNECT_S', 0.5)
    with pytest.raises(InputError, match='has no workers; start some with "dask worker tcp:'):
        swept_on(real.address, tmp_path)
    lacking = real.worker(HIDDEN)
    with pytest.raises(InputError, match='cannot import visual_servo_epipolar .*; install this'):
        swept_on(real.address, tmp_path)
    real.stop(lacking)
    real.worker(OTHER)
    with pytest.raises(InputError, match=r'runs different code .*\(other there, .* here\)'):
        swept_on(real.address, tmp_path)


@pytest.mark.long
def test_a_sweep_outlives_a_worker_but_not_the_last_one(tmp_path, real, monkeypatch) -> None:
    monkeypatch.setattr(store_module, 'PATIENCE_S', 0.5)
    crew, seen = [real.worker(), real.worker()], []

    def watch(results: list[Any]) -> None:
        seen.append(len(results))
        if len(seen) in (1, 5):
            real.stop(crew.pop())

    with pytest.raises(VisualServoError, match='has lost all its workers; finished runs are kept'):
        swept_on(real.address, tmp_path / 'out', MANY, watch)
    with Store(tmp_path / 'out', plan_of(MANY)) as store:
        assert len(seen) >= 5 and len(store.results) == sum(seen)


@pytest.mark.long
def test_a_scheduler_that_dies_is_reported(tmp_path: Path, real: Cluster) -> None:
    real.worker()
    with pytest.raises(VisualServoError, match='the cluster at .* was lost'):
        swept_on(real.address, tmp_path / 'out', MANY, lambda _: real.scheduler.kill())


@pytest.mark.parametrize('address', ['nonsense', 'http://127.0.0.1:80', 'tcp://127.0.0.1:1', ''])
def test_an_address_without_answer_is_refused(tmp_path, capsys, monkeypatch, address: str) -> None:
    monkeypatch.setattr(cluster, 'CONNECT_S', 0.5)
    scenario = tmp_path / 'scenario.yaml'
    scenario.write_text(f'run: {{max_duration: {BRIEF.run.max_duration}}}')
    assert main([*SWEEP, str(scenario), '--scheduler', address, '--out', str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f'visual_servo sweep: no Dask scheduler answers at {address!r}')
    assert len(said.splitlines()) == 1, said
