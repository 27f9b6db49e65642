"""What ended is kept; what was cut off is dropped; two sweeps are never mixed."""

import json
import math
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
import pytest
from scipy import stats
from sweeps import filled, plan_of, result

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.sweeping import store as store_module
from visual_servo_epipolar.sweeping.plan import Chunk, SweepPlan
from visual_servo_epipolar.sweeping.store import FILE, Store
from visual_servo_epipolar.sweeping.summary import quantile, summaries, wilson

RESULTS = [result(seed=seed) for seed in range(3)]


def refused(folder: Path, plan: SweepPlan) -> str:
    with pytest.raises(InputError) as error:
        Store(folder, plan)
    assert len(str(error.value).splitlines()) == 1
    return str(error.value)


def test_a_line_is_on_disk_when_add_returns(tmp_path: Path) -> None:
    store = filled(tmp_path, plan_of(), RESULTS)
    lines = (tmp_path / FILE).read_text().splitlines()
    assert [json.loads(line)['result'] for line in lines[1:]] == RESULTS
    store.close()


@pytest.mark.parametrize('cut', [1, 30, 10_000])
def test_a_last_line_that_was_cut_off_is_dropped(tmp_path: Path, cut: int) -> None:
    filled(tmp_path, plan_of(), RESULTS).close()
    path = tmp_path / FILE
    *whole, last = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b''.join(whole) + last[: max(1, len(last) - cut)])
    with Store(tmp_path, plan_of()) as store:
        assert set(store.results) == {('full', 0), ('full', 1)}
        store.add(Chunk('full', (2,)), [RESULTS[2]])
    with Store(tmp_path, plan_of()) as store:
        assert [store.results['full', index] for index in range(3)] == RESULTS


def test_a_header_that_was_cut_off_is_written_again(tmp_path: Path) -> None:
    Store(tmp_path, plan_of()).close()
    whole = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(whole[:50])
    with Store(tmp_path, plan_of()) as store:
        assert store.results == {}
    assert (tmp_path / FILE).read_bytes() == whole


def test_time_adds_up_over_sessions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(store_module.time, 'monotonic', lambda: now[0])
    for index, seconds in enumerate((10.0, 5.0)):
        with Store(tmp_path, plan_of()) as store:
            now[0] += seconds
            store.add(Chunk('full', (index,)), [RESULTS[index]])
            now[0] += 100.0  # killed: nothing came of that
    with Store(tmp_path, plan_of()) as store:
        now[0] += 2.0
        assert store.wall_s == 17.0


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'seed': 1}, 'seed 0 there, 1 here'),
        ({'region': 'beside'}, "region 'front' there, 'beside' here"),
        ({'laws': ('paper', 'full')}, r"laws \['full'\] there, \['paper', 'full'\] here"),
    ],
)
def test_another_sweep_is_refused_and_left_alone(tmp_path, changes, reason) -> None:
    filled(tmp_path, plan_of(), RESULTS).close()
    before = (tmp_path / FILE).read_bytes()
    with pytest.raises(InputError, match=f'holds another sweep: .*{reason}.*give another --out'):
        Store(tmp_path, plan_of(**changes))
    assert (tmp_path / FILE).read_bytes() == before


def test_another_scenario_is_named_setting_by_setting(tmp_path: Path) -> None:
    plan = plan_of()
    filled(tmp_path, plan, RESULTS).close()
    said = refused(tmp_path, plan_of(scenario=plan.scenario.with_servo({'k1': 0.09})))
    assert 'scenario.servo.k1 0.08 there, 0.09 here' in said


def test_runs_of_other_code_are_not_mixed_in(tmp_path, monkeypatch) -> None:
    filled(tmp_path, plan_of(), RESULTS).close()
    monkeypatch.setattr(store_module, 'digest', lambda: 'abcdef')
    assert 'abcdef' in refused(tmp_path, plan_of())


def test_a_store_without_runs_makes_way_for_another_sweep(tmp_path: Path) -> None:
    Store(tmp_path, plan_of()).close()
    filled(tmp_path, plan_of(seed=1), RESULTS).close()
    with Store(tmp_path, plan_of(seed=1)) as store:
        assert len(store.results) == 3


def test_a_folder_has_one_writer(tmp_path: Path) -> None:
    with Store(tmp_path, plan_of()):
        assert 'another sweep is writing here' in refused(tmp_path, plan_of())
    Store(tmp_path, plan_of()).close()


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ('{"a": 1}\n', 'not the results of a sweep'),
        ('hello\n', 'runs.jsonl:1: not a line of a sweep'),
        ('{HEADER}\nhello\n', 'runs.jsonl:2: not a line of a sweep'),
        ('{HEADER}\n{"law": "full"}\n', "runs.jsonl:2: lacks 'result'"),
    ],
)
def test_a_file_that_is_no_store_is_refused(tmp_path: Path, content: str, reason: str) -> None:
    Store(tmp_path, plan_of()).close()
    header = (tmp_path / FILE).read_text().rstrip('\n')
    (tmp_path / FILE).write_text(content.replace('{HEADER}', header))
    assert reason in refused(tmp_path, plan_of())


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    assert 'results cannot be kept' in refused(tmp_path / 'file' / 'folder', plan_of())


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


def test_a_sweep_without_arrivals_has_no_errors(tmp_path: Path) -> None:
    document = summary(tmp_path, [FAILED, FAILED])
    assert (document['success_rate'], document['arrived']) == (0.0, 0)
    assert math.isnan(document['position_error_m']['median'])


def test_reasons_are_counted_whatever_their_numbers(tmp_path: Path) -> None:
    other = result(outcome='failed', reason='25 features, 26 needed')
    third = result(outcome='failed', reason='not arrived within 2.5 s')
    document = summary(tmp_path, [third, FAILED, result(), other])
    assert document['failure_reasons'] == {'N features, N needed': 2, 'not arrived within N s': 1}


@pytest.mark.parametrize(
    ('changes', 'is_wrong'),
    [
        ({}, False),
        ({'position_error_m': 0.051}, True),
        ({'heading_error_deg': -2.1}, True),
        ({'position_error_m': 0.051, 'outcome': 'failed'}, False),
    ],
)
def test_a_run_that_reports_arrival_elsewhere_is_wrong(tmp_path, changes, is_wrong) -> None:
    assert summary(tmp_path, [result(**changes)])['arrived_but_wrong'] == is_wrong


def test_what_a_run_lacks_is_no_value_and_one_that_raised_is_a_defect(tmp_path: Path) -> None:
    raised = result(outcome='failed', position_error_m=None, traceback='Traceback ...')
    from_goal = {k: v for k, v in result().items() if k != 'wrong_geometry_s'}  # of before
    runs = [raised, FAILED, from_goal | {'max_distance_ratio': None}, result()]
    document = summary(tmp_path, [*runs[:3], result(wrong_geometry_s=0.5)])
    assert document['defects'] == 1
    assert document['max_distance_ratio']['max'] == 1.0
    assert document['wrong_geometry_s']['max'] == 0.5


def test_only_the_runs_asked_for_are_judged(tmp_path: Path) -> None:
    filled(tmp_path, plan_of(3), [result(), result(), FAILED]).close()
    with filled(tmp_path, plan_of(2), []) as store:
        assert summaries(plan_of(2), store)['full']['success_rate'] == 1.0


@given(st.integers(1, 2000), st.data())
def test_wilson_is_that_of_scipy(trials: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(0, trials))
    theirs = stats.binomtest(successes, trials).proportion_ci(method='wilson')
    assert wilson(successes, trials) == pytest.approx((theirs.low, theirs.high), abs=1e-9)


def test_nothing_is_known_without_a_trial() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert math.isnan(quantile([], 0.95))
