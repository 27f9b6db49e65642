"""The document of a sweep says what its runs say, and nothing about runs that never arrived."""

import math
from pathlib import Path
from typing import Any

import pytest
from sweeps import filled, plan_of, result

from visual_servo_epipolar.sweeping.summary import defective, summaries, wrong

FAILED = result(outcome='failed', reason='23 features, 26 needed', position_error_m=9.0)


def summary(folder: Path, runs: list[dict[str, Any]]) -> dict[str, Any]:
    plan = plan_of(len(runs))
    with filled(folder, plan, runs) as store:
        return summaries(plan, store)['full']


def test_errors_are_those_of_the_runs_that_arrived_without_their_signs(tmp_path: Path) -> None:
    runs = [result(lateral_error_m=-0.001 * k) for k in range(1, 6)]
    document = summary(tmp_path, [*runs, FAILED])
    lateral = document['lateral_error_m']
    assert (lateral['median'], lateral['max']) == (0.003, 0.005)
    assert lateral['p95'] == pytest.approx(0.0048)
    assert document['success_rate'] == pytest.approx(5 / 6)
    assert document['position_error_m']['max'] == 0.002
    assert document['runs'] == [*runs, FAILED]


def test_a_sweep_from_which_nobody_returned_has_no_errors(tmp_path: Path) -> None:
    document = summary(tmp_path, [FAILED, FAILED])
    assert (document['success_rate'], document['arrived']) == (0.0, 0)
    assert math.isnan(document['position_error_m']['median'])


def test_reasons_are_counted_whatever_their_numbers(tmp_path: Path) -> None:
    other = result(outcome='failed', reason='25 features, 26 needed')
    third = result(outcome='failed', reason='not arrived within 2.5 s')
    document = summary(tmp_path, [third, FAILED, result(), other])
    assert document['failure_reasons'] == {
        'N features, N needed': 2,
        'not arrived within N s': 1,
    }


@pytest.mark.parametrize(
    ('changes', 'is_wrong'),
    [
        ({}, False),
        ({'position_error_m': 0.051}, True),
        ({'heading_error_deg': -2.1}, True),
        ({'position_error_m': 0.051, 'outcome': 'failed'}, False),
    ],
)
def test_wrong_is_who_says_arrived_and_is_not(
    tmp_path: Path, changes: dict[str, Any], is_wrong: bool
) -> None:
    assert wrong(result(**changes)) is is_wrong
    assert summary(tmp_path, [result(**changes)])['arrived_but_wrong'] == is_wrong


def test_a_run_that_raised_is_a_defect(tmp_path: Path) -> None:
    raised = result(outcome='failed', position_error_m=None, traceback='Traceback ...')
    assert defective(raised) and not defective(FAILED)
    assert summary(tmp_path, [raised, FAILED])['defects'] == 1


def test_a_run_from_the_goal_has_no_distance_ratio(tmp_path: Path) -> None:
    document = summary(tmp_path, [result(max_distance_ratio=None), result()])
    assert document['max_distance_ratio']['max'] == 1.0


def test_excursion_and_wrong_geometry_are_those_of_all_runs(tmp_path: Path) -> None:
    lost = {**FAILED, 'max_distance_ratio': 5.0, 'wrong_geometry_s': 30.0}
    document = summary(tmp_path, [result(), lost])
    assert (document['excursion']['max'], document['wrong_geometry_s']['max']) == (5.0, 30.0)
    assert document['max_distance_ratio']['max'] == 1.0


def test_runs_of_before_there_was_a_judge_can_be_summed_up(tmp_path: Path) -> None:
    unjudged = {key: value for key, value in result().items() if key != 'wrong_geometry_s'}
    document = summary(tmp_path, [unjudged, result(wrong_geometry_s=0.5)])
    assert document['wrong_geometry_s']['median'] == 0.5


def test_only_the_runs_asked_for_are_judged(tmp_path: Path) -> None:
    filled(tmp_path, plan_of(3), [result(), result(), FAILED]).close()
    with filled(tmp_path, plan_of(2), []) as store:
        assert summaries(plan_of(2), store)['full']['success_rate'] == 1.0
