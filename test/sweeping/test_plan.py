"""Plans of sweeps: their starts, and the workers that drive them."""

import argparse
import json
import os
from pathlib import Path
import shlex
import signal
import subprocess
import sys

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from sweeps import BRIEF, plan_of

from visual_servo_epipolar.commands.arguments import scenario_of
from visual_servo_epipolar.commands.main import parser
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.simulation.closed_loop import Loop, verdict
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import drive
from visual_servo_epipolar.sweeping.plan import Chunk, result_of, work
from visual_servo_epipolar.sweeping.workers import MEMORY, THREADS, worker_pool

LAWS = ('paper', 'corrected', 'full')
WHOLE = st.integers(0, 2**31 - 1)


def parsed(command: str) -> argparse.Namespace:
    program, *arguments = shlex.split(command)
    assert program == 'visual_servo'
    return parser().parse_args(arguments)


@given(
    st.integers(1, 60),
    st.sampled_from([('full',), LAWS]),
    st.integers(1, 40),
    st.sampled_from(['features', 'images']),
    st.data(),
)
def test_chunks_hold_each_missing_run_once(runs, laws, workers, source, data) -> None:
    plan = plan_of(runs, laws=laws, source=source)
    done = data.draw(st.sets(st.sampled_from(plan.keys())))
    chunks = plan.chunks(done, workers)
    shared = [(chunk.law, index) for chunk in chunks for index in chunk.indices]
    assert len(shared) == len(set(shared))
    assert set(shared) | done == set(plan.keys())
    assert not set(shared) & done


@given(WHOLE, st.integers(0, 10**6))
def test_the_seed_of_a_run_is_one_that_simulate_takes(seed: int, index: int) -> None:
    plan = plan_of(seed=seed)
    assert 0 <= plan.run_seed(index) < 2**31
    assert plan.run_seed(index) == plan.run_seed(index)


def test_runs_and_sweeps_differ_in_their_seeds() -> None:
    seeds = {plan_of(seed=seed).run_seed(index) for seed in range(20) for index in range(50)}
    assert len(seeds) == 1000


def test_the_identity_of_a_sweep_is_its_parameters_but_not_their_number_of_runs() -> None:
    one = plan_of(10)
    assert json.loads(json.dumps(one.identity())) == one.identity()
    assert plan_of(20).identity() == one.identity()
    others = [
        plan_of(laws=('paper',)),
        plan_of(laws=LAWS),
        plan_of(source='images'),
        plan_of(region='beside'),
        plan_of(seed=1),
        plan_of(scenario=BRIEF.with_servo({'k1': 0.09})),
    ]
    assert all(other.identity() != one.identity() for other in others)


def test_the_identity_does_not_depend_on_how_the_law_came_in() -> None:
    by_file = plan_of(laws=('paper',), scenario=BRIEF.with_servo({'law': 'paper'}).seeded(5))
    assert by_file.identity() == plan_of(laws=('paper',)).identity()


@pytest.mark.parametrize('laws', [('full',), LAWS])
def test_the_command_of_a_sweep_asks_for_this_sweep(laws: tuple[str, ...]) -> None:
    plan = plan_of(
        7,
        region='beside',
        source='images',
        laws=laws,
        scenario=BRIEF.with_servo({'estimator': 'lmeds_8pt'}),
        seed=3,
        scenes=(5, 101),
        scenario_name='my scenario.yaml',
    )
    options = parsed(plan.command())
    assert (options.region, options.runs, options.source) == ('beside', 7, 'images')
    assert (options.compare or (options.law,), options.seed) == (laws, 3)
    assert (options.estimator, options.scenario) == ('lmeds_8pt', 'my scenario.yaml')
    assert options.scenes == (5, 101)


@settings(max_examples=8)
@given(st.tuples(*[st.floats(-9.0, 9.0)] * 3), st.integers(0, 999), st.sampled_from([(), (4, 8)]))
def test_the_command_of_a_run_asks_for_this_run(start, index, scenes) -> None:
    plan = plan_of(1000, scenes=scenes, scenario=Scenario())
    options = parsed(plan.command_of_run('corrected', index, start))
    assert tuple(options.start) == start
    assert options.source == 'features'
    # What simulate makes of these options is what the sweep runs.
    assert scenario_of(options) == plan.scenario_of('corrected', index)
    assert options.seed == plan.run_seed(index)


def test_runs_take_turns_in_the_scenes() -> None:
    plan = plan_of(scenes=(4, 8, 9))
    rooms = [plan.scenario_of('full', index).camera.scene_seed for index in range(4)]
    assert rooms == [4, 8, 9, 4]
    assert plan.identity() != plan_of().identity()


STARTS = [(0.5, -3.0, 5.0), (-1.0, -4.0, 0.0)]


def test_a_result_is_that_of_the_run_alone() -> None:
    for start, seed in zip(STARTS, [3, 4], strict=True):
        scenario = BRIEF.seeded(seed)
        found = result_of(scenario, start, seed, 'features')
        assert found == verdict(drive(scenario, start, seed), scenario.camera.rig())


@pytest.mark.parametrize('scenes', [(), (3, 3, 4)])
def test_results_do_not_depend_on_the_chunks(scenes) -> None:
    plan = plan_of(4, scenes=scenes)
    whole = work(plan, Chunk('full', (0, 1, 2, 3)))
    assert [work(plan, Chunk('full', (index,)))[0] for index in range(4)] == whole
    assert work(plan, Chunk('full', (3, 1))) == [whole[3], whole[1]]


def test_all_laws_have_the_same_starts_and_seeds() -> None:
    plan = plan_of(2, laws=('paper', 'full'))
    paper, full = (work(plan, Chunk(law, (0, 1))) for law in plan.laws)
    for one, other in zip(paper, full, strict=True):
        assert (one['start'], one['seed']) == (other['start'], other['seed'])
        assert (one['law'], other['law']) == ('paper', 'full')


def test_a_run_that_raises_does_not_take_the_others_along(monkeypatch: pytest.MonkeyPatch) -> None:
    record = Loop.record

    def sometimes(loop: Loop) -> Sample:
        if loop.monitor.settings.seed == 3 and loop.driven.frame == 5:
            raise ZeroDivisionError('of all things')
        return record(loop)

    monkeypatch.setattr(Loop, 'record', sometimes)
    broken, sound = (
        result_of(BRIEF.seeded(seed), start, seed, 'features')
        for start, seed in zip(STARTS, [3, 4], strict=True)
    )
    assert (broken['outcome'], broken['start'], broken['seed']) == ('failed', [0.5, -3.0, 5.0], 3)
    assert broken['reason'] == 'defect: ZeroDivisionError: of all things'
    assert 'in sometimes' in broken['traceback']
    assert sound.keys() | {'traceback'} == broken.keys()
    assert 'traceback' not in sound


ROOT = Path(__file__).parents[2]


def test_workers_alone_have_one_thread_and_keep_their_memory() -> None:
    before = dict(os.environ)
    with worker_pool(1, 'try again') as pool:
        told = {name: pool.submit(os.getenv, name).result() for name in (*THREADS, *MEMORY)}
    assert told == {**dict.fromkeys(THREADS, '1'), **MEMORY}
    assert dict(os.environ) == before


# Read by every Python that is started with its folder on PYTHONPATH: Ctrl-C at its first line.
STRUCK = """
import os, signal, sys
if '--multiprocessing-fork' in sys.orig_argv:
    os.kill(os.getpid(), signal.SIGINT)
"""
POOL = """
import signal
from visual_servo_epipolar.sweeping.workers import worker_pool

if __name__ == '__main__':
    with worker_pool(1, 'try again') as pool:
        print(pool.submit(signal.getsignal, signal.SIGINT).result().name)
        print(pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result())
"""


def test_a_worker_that_is_still_loading_leaves_ctrl_c_to_its_parent(tmp_path: Path) -> None:
    (tmp_path / 'sitecustomize.py').write_text(STRUCK)
    (tmp_path / 'pool.py').write_text(POOL)
    path = [str(tmp_path), str(ROOT), os.environ.get('PYTHONPATH', '')]
    ended = subprocess.run(
        [sys.executable, str(tmp_path / 'pool.py')],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, path))},
        capture_output=True,
        text=True,
        timeout=120.0,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.split('\n') == ['SIG_IGN', 'set()', '']
