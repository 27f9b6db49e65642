"""The sweep as its users meet it: JSON, folders, exit codes; killed, it goes on."""

import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
from typing import Any

from command_line import document, refusal, started, TIMEOUT_SEC, TINY, wait_for
import cv2
import psutil
import pytest
from sweeps import plan_of

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.sweeping.plan import Chunk, work
from visual_servo_epipolar.sweeping.store import FILE

MANY = '96'  # runs, which go on while something happens to them
BRIEF = 'run: {max_duration: 2.0}\n'  # too short to arrive
SWEEP = ('sweep', '--region', 'front')


@pytest.fixture(scope='module')
def two_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep of two runs, to be copied."""
    folder = tmp_path_factory.mktemp('two_runs')
    (folder / 'brief.yaml').write_text(BRIEF)
    common = ('--jobs', '1', '--scenario', str(folder / 'brief.yaml'), '--out', str(folder))
    assert main([*SWEEP, '--runs', '2', *common, '--json', str(folder / 'result.json')]) == 0
    return folder


@pytest.fixture
def brief(tmp_path: Path) -> str:
    path = tmp_path / 'brief.yaml'
    path.write_text(BRIEF)
    return str(path)


def runs_in(folder: Path) -> int:
    path = folder / FILE
    return path.read_bytes().count(b'\n') - 1 if path.exists() else 0


def wait_for_runs(folder: Path, runs: int, process: 'subprocess.Popen[str]') -> None:
    """Wait until ``runs`` results are in the store while the sweep goes on."""
    wait_for(process, lambda: runs_in(folder) >= runs, f'{runs} runs')


def test_a_sweep_arrives_and_reports(tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / 'out'
    out.mkdir()
    (out / 'old.png').touch()
    assert main([*SWEEP, '--runs', '3', '--out', str(out), '--json', str(tmp_path / 'j')]) == 0
    shown = capsys.readouterr()
    assert '100 % (3 of 3)' in shown.out
    assert shown.out.splitlines()[-1] == f'written to {out}: map.png, runs.jsonl, table.md'
    assert shown.err == ''
    result = json.loads((tmp_path / 'j').read_text())
    assert result['success_rate'] == 1.0
    assert len(result['runs']) == 3
    for name in ('position_error_m', 'lateral_error_m', 'longitudinal_error_m'):
        assert 0.0 <= result[name]['median'] <= result[name]['p95'] <= result[name]['max']
        assert result[name]['max'] < 0.05
    assert result['heading_error_deg']['max'] < 2.0
    assert result['wall_s'] > 0.0
    names = {'runs.jsonl', 'table.md', 'map.png', 'old.png'}
    assert {path.name for path in out.iterdir()} == names
    assert cv2.imread(str(out / 'map.png')).std() > 0.0


def test_images_are_swept_too(tmp_path: Path, capsys: Any) -> None:
    scenario = tmp_path / 'tiny.yaml'
    scenario.write_text(f'{TINY}run: {{max_duration: 1.0}}')
    common = ('--source', 'images', '--scenario', str(scenario))
    here = ('--jobs', '1', '--scenes', '8', '--out', str(tmp_path / 'out'))
    (single,) = document(capsys, *SWEEP, '--runs', '1', *common, *here)['runs']
    assert 'not arrived within 1 s' in single['reason']
    start = [str(value) for value in single['start']]
    seeds = ('--scene', '8', '--seed', str(single['seed']))
    assert document(capsys, 'simulate', '--start', *start, *common, *seeds, code=1) == single


def test_without_a_folder_each_sweep_gets_its_own(tmp_path, capsys, brief, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    common = ('--runs', '1', '--jobs', '1', '--scenario', brief)
    for seed in ('1', '2'):
        document(capsys, *SWEEP, *common, '--seed', seed)
    folders = sorted(path.name for path in (tmp_path / 'sweep_out').iterdir())
    assert len(folders) == 2
    assert folders[0].startswith('front-features-full-seed1-')


@pytest.mark.long
def test_a_sweep_killed_goes_on_where_it_was(tmp_path: Path, capsys: Any, brief: str) -> None:
    folder = tmp_path / 'out'
    common = ('--jobs', '2', '--scenario', brief)
    with started(*SWEEP, *common, '--runs', MANY, '--out', str(folder)) as process:
        wait_for_runs(folder, 8, process)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.wait(TIMEOUT_SEC)
        gone, alive = psutil.wait_procs(workers, timeout=TIMEOUT_SEC)
    assert workers and not alive
    kept = (folder / FILE).read_bytes()
    kept = kept[: kept.rfind(b'\n') + 1]
    runs = kept.count(b'\n') + 7  # eight to go
    resumed = document(capsys, *SWEEP, *common, '--runs', str(runs), '--out', str(folder))
    assert (folder / FILE).read_bytes().startswith(kept)
    assert resumed['runs'] == work(plan_of(runs), Chunk('full', tuple(range(runs))))


@pytest.mark.parametrize(
    ('number', 'code'),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)],
)
def test_an_interrupted_sweep_ends_with_its_workers(tmp_path, brief, number, code) -> None:
    folder = tmp_path / 'out'
    arguments = ('--runs', MANY, '--jobs', '2', '--scenario', brief, '--out', str(folder))
    with started(*SWEEP, *arguments) as process:
        wait_for_runs(folder, 1, process)
        workers = psutil.Process(process.pid).children(recursive=True)
        os.killpg(process.pid, number)  # as Ctrl-C and timeout(1) do: to all of them
        _, output = process.communicate(timeout=TIMEOUT_SEC)
        assert process.returncode == code
        assert not psutil.wait_procs(workers, timeout=TIMEOUT_SEC)[1]
    assert output == 'visual_servo sweep: interrupted\n'
    assert [path.name for path in folder.iterdir()] == [FILE]


@pytest.mark.long
def test_a_killed_worker_is_reported_and_what_ended_is_kept(tmp_path, brief: str) -> None:
    folder = tmp_path / 'out'
    arguments = ('--runs', MANY, '--jobs', '1', '--scenario', brief, '--out', str(folder))
    with started(*SWEEP, *arguments) as process:
        wait_for_runs(folder, 8, process)
        # Beside the worker there is the tracker of shared resources.
        for child in psutil.Process(process.pid).children():
            if 'resource_tracker' not in ' '.join(child.cmdline()):
                child.kill()
        _, output = process.communicate(timeout=TIMEOUT_SEC)
    assert process.returncode == 1
    assert 'a worker process died' in output and 'the same command goes on from there' in output
    assert len(output.splitlines()) == 1, output
    assert runs_in(folder) >= 8


def test_a_sweep_grows(tmp_path: Path, capsys: Any, brief: str, two_runs: Path) -> None:
    shutil.copy(two_runs / FILE, tmp_path)
    common = ('--jobs', '1', '--scenario', brief, '--out', str(tmp_path))
    assert main([*SWEEP, *common, '--runs', '3', '--json', '-']) == 0
    shown = capsys.readouterr()
    few = json.loads((two_runs / 'result.json').read_text())
    assert json.loads(shown.out)['runs'][:2] == few['runs']
    assert f'2 of 3 runs are in {tmp_path / FILE} already' in shown.err


def test_a_run_that_raised_is_named_and_it_ends_with_1(tmp_path, capsys, brief, two_runs) -> None:
    arguments = (*SWEEP, '--runs', '2', '--jobs', '1', '--scenario', brief)
    # A defect is what the store says it is: no other code can be put into the workers.
    header, first, second = (two_runs / FILE).read_text().splitlines()
    line = json.loads(second)
    broken = line['result']
    broken.update(reason='defect: ZeroDivisionError: x', traceback='...', position_error_m=None)
    (tmp_path / FILE).write_text(f'{header}\n{first}\n{json.dumps(line)}\n')
    assert main([*arguments, '--out', str(tmp_path)]) == 1
    shown = capsys.readouterr()
    start = ' '.join(f'{value}' for value in broken['start'])
    assert f'visual_servo simulate --start {start} --source features' in shown.err
    assert f'--scenario {brief} --seed {broken["seed"]}' in shown.err
    assert 'defect: ZeroDivisionError' in shown.err


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        *(
            (f'--runs {number}', 'not a whole number from 1')
            for number in ('0', 'x', '9999999999')
        ),
        ('', 'required: --runs'),
        ('--runs 1 --jobs 0', 'not a whole number from 1'),
        ('--runs 1 --region behind', 'invalid choice'),
        ('--runs 1 --compare full,best', 'law must be one of paper, corrected, full'),
        ('--runs 1 --compare full,full', 'each law once'),
        ('--runs 1 --compare=', 'law must be one of'),
        ('--runs 1 --law full --compare full', 'exclude each other'),
        ('--runs 1 --jobs 1 --scheduler tcp://x', 'not allowed with'),
        ('--runs 1 --scenes 7-8', '--scenes needs --source images'),
        ('--runs 1 --scenes 8-7', 'not a range'),
        ('--runs 1 --scenes 7,x', 'not a whole number'),
    ],
)
def test_bad_usage_is_refused(tmp_path, capsys, options, reason, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert reason in refusal(capsys, *SWEEP, *options.split())
    assert list(tmp_path.iterdir()) == []
