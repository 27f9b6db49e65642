"""The sweep benchmark: its rates are those of its runs, its parts are all of them."""

import re
from typing import Any

import pytest

from visual_servo_epipolar.evaluation.benchmarks.speed import sweep
from visual_servo_epipolar.simulation.closed_loop import PARTS


@pytest.fixture(scope='module')
def document() -> dict[str, Any]:
    return sweep.run(seed=0, quick=True, say=lambda text: None)


@pytest.mark.long
def test_a_run_is_the_same_in_every_batch(document: dict[str, Any]) -> None:
    assert [it['identical'] for it in document['scenarios']] == 3 * [True]


def test_with_the_memory_and_without_it_are_measured() -> None:
    remembers = {name: it.servo.remembers for name, it in sweep.SCENARIOS.items()}
    assert remembers == {'nominal': True, 'rough': True, 'nominal, two views': False}


def test_records_that_differ_are_told_apart() -> None:
    assert not sweep._agree([['one'], ['other', 'third']])


@pytest.mark.long
def test_the_parts_make_up_the_step(document: dict[str, Any]) -> None:
    for it in document['scenarios']:
        for row in it['batches']:
            whole = sum(row['parts_us'].values())
            # The rest is to set up and to close the records.
            assert 0.7 * row['step_us'] < whole <= row['step_us']
            assert row['loops_per_s'] * row['steps_per_loop'] * row['step_us'] == pytest.approx(
                1e6
            )


@pytest.mark.long
def test_runs_of_the_nominal_world_arrive(document: dict[str, Any]) -> None:
    for row in document['scenarios'][0]['batches']:
        assert row['arrived'] == row['runs']


@pytest.mark.long
def test_the_table_has_a_row_for_each_batch(document: dict[str, Any]) -> None:
    text = sweep.table(document)
    assert len(re.findall(r'\d us', text)) == 3 * 2 * len(PARTS)
    assert 'the same in every batch' in text
