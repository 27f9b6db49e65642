"""
Golden runs: recorded step by step, and compared between two commits to the last bit.

``make golden BASE=<commit>`` records each commit by the copy of this file that it has, or by this
one: what drives a run may have other names there, the lines that are written have not. ``keep``
writes the few that ``make test`` holds: after a change of behaviour, in a commit that says why.
"""

from collections.abc import Callable
from itertools import groupby, zip_longest
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile
from typing import Any

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / 'config'
HERE = 'test/support/golden.py'
Step = dict[str, Any]
# Loops: law, scenario, rig, start.
FEATURES = {
    'paper': ('paper', '', '', (1.0, -3.0, 0.0)),
    'corrected': ('corrected', '', '', (0.4, -2.0, 5.0)),
    'full': ('full', '', '', (-0.8, -3.0, 8.0)),
    'full_beside': ('full', '', '', (0.9, 0.3, -10.0)),
    'smooth': ('smooth', '', '', (0.8, -2.5, -8.0)),
    'realistic': ('full', 'realistic', '', (0.5, -2.5, 5.0)),
    'harsh': ('smooth', 'harsh', '', (0.5, -2.0, 5.0)),
    'flat': ('smooth', 'flat', '', (0.5, -2.0, 5.0)),
    'cheap': ('smooth', 'cheap', '', (-0.5, -2.0, 5.0)),
    'fisheye': ('smooth', '', 'fisheye', (0.7, -1.5, 20.0)),
    'panorama': ('smooth', '', 'panorama', (0.7, -1.5, 120.0)),
    'pan': ('smooth', '', 'pan', (1.2, -1.0, 20.0)),
    'car': ('smooth', '', 'car', (0.3, -2.5, 5.0)),
}
IMAGES = {
    'images': ('smooth', 'small', '', (0.3, -1.0, 3.0)),
    'images_harsh': ('full', 'harsh', 'panorama_small', (0.2, -0.9, 5.0)),
}
FAULT = 'wheels_slip', 0
ROUTE = ((3.0, -3.9), (3.0, -1.2), (4.4, -1.2))


def loop(source: str, law: str, scenario: str, rig: str, start: Any) -> list[Step]:
    """Return the steps of a closed loop in memory."""
    from visual_servo_epipolar.core.servo.run_log import Sample
    from visual_servo_epipolar.simulation.closed_loop import Loop, RunMonitor
    from visual_servo_epipolar.simulation.scenario import load
    from visual_servo_epipolar.simulation.views import view_of

    rows: list[Step] = []

    class Recorder(RunMonitor):
        """A monitor that keeps reasons as well."""

        def add(self, sample: Sample, *, reason: str, attempts: int) -> None:
            step = sample.stamp_ns, sample.pose, sample.twist, sample.phase.value, reason
            rows.append(row(*step))
            super().add(sample, reason=reason, attempts=attempts)

    files = [
        CONFIG / kind / f'{name}.yaml' if name else None
        for kind, name in (('scenarios', scenario), ('rigs', rig))
    ]
    it = load(*files).seeded(3).with_servo({'law': law})
    settings = it.loop(start, 3)
    run = Loop(settings, view_of(it, source, 3), it.camera.nominal_camera)
    run.monitor = Recorder(settings)
    log = run.run()
    return [*rows, {'outcome': log.outcome, 'reason': log.reason}]


def fault(name: str, seed: int) -> list[Step]:
    """Return ground truth of a run of the campaign, then what became of it."""
    from visual_servo_epipolar.evaluation.faults import campaign

    records: list[Any] = []
    judge = campaign.judge_run
    campaign.judge_run = lambda record, bounds: judge(records.append(record) or record, bounds)
    result = campaign.drive_one(name, campaign.FAULTS[name], seed)
    rows = [row(round(1e9 * it.time_s), it.pose, it.twist) for it in records[0].truths]
    rows += [row(round(1e9 * it.time_s), None, it.twist) for it in records[0].orders]
    return [*rows, {**result, 'charges': list(result['charges'])}]


def route() -> list[Step]:
    """Return the steps of a repetition of a short way, then what became of it."""
    from visual_servo_epipolar.core.routes.settings import FollowSettings
    from visual_servo_epipolar.simulation import routes
    from visual_servo_epipolar.simulation.scenario import Scenario

    scenario, rows = routes.route_scenario(Scenario(), 1), []

    def watch(image: Any, pose: Any, step: Any) -> None:
        rows.append(row(len(rows), pose, step.twist, step.phase, step.reason))

    taught = routes.teach(scenario, routes.rounded(ROUTE))
    log = routes.repeat(scenario.seeded(2), taught, FollowSettings(), watch=watch)
    return [*rows, {'outcome': log.outcome, 'reason': log.reason, 'station': list(log.station)}]


def row(stamp_ns: int, pose: Any, twist: Any, phase: str = '', reason: str = '') -> Step:
    """Return a step as it is written."""
    place = {} if pose is None else {'x': pose.x, 'y': pose.y, 'theta': pose.theta}
    command = {'v': float(twist.linear), 'w': float(twist.angular)}
    return {'stamp_ns': stamp_ns, **place, **command, 'phase': phase, 'reason': reason}


RUNS: dict[str, Callable[[], list[Step]]] = {
    **{name: lambda it=it: loop('features', *it) for name, it in FEATURES.items()},
    **{name: lambda it=it: loop('images', *it) for name, it in IMAGES.items()},
    'fault': lambda: fault(*FAULT),
    'route': route,
}


KEPT = Path(__file__).parents[1] / 'simulation/golden.json'
SMALL = ('paper', 'full', 'realistic', 'pan', 'car')  # kept, for `make test`


def summary(rows: list[Step]) -> Step:
    """Return phases, outcome and final pose of a closed loop."""
    *steps, end = rows
    phases = [phase for phase, _ in groupby(step['phase'] for step in steps)]
    pose = [steps[-1][name] for name in ('x', 'y', 'theta')]
    return {'outcome': end['outcome'], 'phases': phases, 'pose': pose}


def record(folder: Path) -> None:
    """Write each run as lines of JSON, which holds every bit of a number."""
    for name, drive in RUNS.items():
        try:
            rows = drive()
        except Exception as error:  # another commit may lack a law, or a fault
            rows = [{'outcome': f'{type(error).__name__}: {error}'}]
        lines = [json.dumps(each, default=float) for each in rows]
        (folder / f'{name}.jsonl').write_text('\n'.join(lines) + '\n', encoding='utf-8')


def recorded(tree: Path, folder: Path) -> dict[str, list[Step]]:
    """Return the runs of the source in ``tree``, driven by a process of its own."""
    folder.mkdir()
    threads = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'), '1')
    if not (tree / HERE).is_file():
        shutil.copy(ROOT / HERE, tree / HERE)
    command = [sys.executable, tree / HERE, 'record', folder]
    subprocess.run(command, env={**os.environ, **threads, 'PYTHONPATH': str(tree)}, check=True)
    return {
        path.stem: [json.loads(line) for line in path.read_text(encoding='utf-8').splitlines()]
        for path in folder.iterdir()
    }


def difference(one: list[Step], other: list[Step]) -> str:
    """Return the first step and field that differ; '' where none does."""
    for number, (before, after) in enumerate(zip_longest(one, other, fillvalue={})):
        for field in {**before, **after}:
            values = before.get(field), after.get(field)
            if repr(values[0]) != repr(values[1]):  # by text: nan equals nan
                return f'step {number}, {field}: {values[0]!r} -> {values[1]!r}'
    return ''


def compare(base: str) -> int:
    """Record ``base`` and the files as they are now; return 1 if a run differs."""
    known = ['git', '-C', str(ROOT), 'rev-parse', '--verify', '--quiet', f'{base}^{{commit}}']
    if subprocess.run(known, stdout=subprocess.DEVNULL).returncode:
        sys.exit(f'golden: BASE must be a commit of this repository, got {base!r}; name another')
    with tempfile.TemporaryDirectory() as place:
        tree = Path(place) / 'base'
        git = ['git', '-C', str(ROOT), 'worktree']
        subprocess.run([*git, 'add', '--detach', '--quiet', tree, base], check=True)
        try:
            before = recorded(tree, Path(place) / 'before')
        finally:
            subprocess.run([*git, 'remove', '--force', tree], check=True)
        after = recorded(ROOT, Path(place) / 'after')
    differing = 0
    for name in sorted({*before, *after}):
        words = difference(before.get(name, []), after.get(name, []))
        differing += bool(words)
        last = after.get(name, [{}])[-1]
        print(f'{name:<14}', words or f'equal, {len(after[name])} steps, {last.get("outcome")}')
    return int(differing > 0)


if __name__ == '__main__':
    if sys.argv[1] == 'record':
        record(Path(sys.argv[2]))
    elif sys.argv[1] == 'keep':
        kept = {name: summary(RUNS[name]()) for name in SMALL}
        KEPT.write_text(json.dumps(kept, indent=1) + '\n', encoding='utf-8')
    else:
        sys.exit(compare(sys.argv[1]))
