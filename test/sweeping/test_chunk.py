"""Whatever a run does, its chunk has a result for it; the same one in every company."""

import pytest
from sweeps import BRIEF, plan_of

from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.run_monitor import verdict
from visual_servo_epipolar.simulation.views import drive
from visual_servo_epipolar.sweeping.plan import Chunk, result_of, work

STARTS = [(0.5, -3.0, 5.0), (-1.0, -4.0, 0.0)]


def test_a_result_is_that_of_the_run_alone() -> None:
    for start, seed in zip(STARTS, [3, 4], strict=True):
        scenario = BRIEF.seeded(seed)
        found = result_of(scenario, start, seed, 'features')
        assert found == verdict(drive(scenario, start, seed), new_rig(scenario.camera))


def test_results_do_not_depend_on_the_chunks() -> None:
    plan = plan_of(4)
    whole = work(plan, Chunk('full', (0, 1, 2, 3)))
    assert [work(plan, Chunk('full', (index,)))[0] for index in range(4)] == whole
    assert work(plan, Chunk('full', (3, 1))) == [whole[3], whole[1]]


def test_all_laws_have_the_same_starts_and_seeds() -> None:
    plan = plan_of(2, laws=('paper', 'full'))
    paper, full = (work(plan, Chunk(law, (0, 1))) for law in plan.laws)
    for one, other in zip(paper, full, strict=True):
        assert (one['start'], one['seed']) == (other['start'], other['seed'])
        assert (one['law'], other['law']) == ('paper', 'full')


def test_a_chunk_may_span_scenes() -> None:
    plan = plan_of(scenes=(3, 3, 4))
    whole = work(plan, Chunk('full', (0, 1, 2, 3)))
    assert [work(plan, Chunk('full', (index,)))[0] for index in range(4)] == whole


def test_a_run_that_raises_does_not_take_the_others_along(monkeypatch: pytest.MonkeyPatch) -> None:
    record = Loop.record

    def sometimes(loop: Loop) -> Sample:
        if loop.monitor.settings.seed == 3 and loop.frame == 5:
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
