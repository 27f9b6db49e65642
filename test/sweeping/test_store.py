"""What ended is kept; what was cut off is dropped; two sweeps are never mixed."""

import json
from pathlib import Path

import pytest
from sweeps import filled, plan_of, result

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.sweeping import store as store_module
from visual_servo_epipolar.sweeping.plan import Chunk, SweepPlan
from visual_servo_epipolar.sweeping.store import FILE, Store

RESULTS = [result(seed=seed) for seed in range(3)]


def refused(folder: Path, plan: SweepPlan) -> str:
    with pytest.raises(InputError) as error:
        Store(folder, plan)
    assert len(str(error.value).splitlines()) == 1
    return str(error.value)


def test_results_are_there_again(tmp_path: Path) -> None:
    filled(tmp_path / 'new' / 'folder', plan_of(), RESULTS).close()
    with Store(tmp_path / 'new' / 'folder', plan_of()) as store:
        assert store.results == {('full', index): RESULTS[index] for index in range(3)}


def test_more_runs_may_be_asked_for(tmp_path: Path) -> None:
    filled(tmp_path, plan_of(runs=3), RESULTS).close()
    with Store(tmp_path, plan_of(runs=100)) as store:
        assert len(store.results) == 3


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
def test_another_sweep_is_refused_and_left_alone(
    tmp_path: Path, changes: dict[str, object], reason: str
) -> None:
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


def test_runs_of_other_code_are_not_mixed_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    filled(tmp_path, plan_of(), RESULTS).close()
    monkeypatch.setattr(store_module, 'digest', lambda: 'abcdef')
    assert 'abcdef' in refused(tmp_path, plan_of())


def test_a_sweep_that_nothing_came_of_is_in_nobodys_way(tmp_path: Path) -> None:
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
