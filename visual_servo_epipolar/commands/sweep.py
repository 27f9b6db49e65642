"""A sweep: many starts through the closed loop, here or on a cluster."""

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from datetime import timedelta
import hashlib
import json
from pathlib import Path
import sys
import time
from typing import Any

from visual_servo_epipolar.commands.arguments import scenario_of
from visual_servo_epipolar.commands.console import Progress, written_to
from visual_servo_epipolar.commands.outputs import publish
from visual_servo_epipolar.core.cameras.model import field_of_view
from visual_servo_epipolar.core.errors import InputError, SHOWN
from visual_servo_epipolar.core.servo.run_log import kind
from visual_servo_epipolar.files import write_whole
from visual_servo_epipolar.nodes.startup.missing import require
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.sweeping.plan import SweepPlan
from visual_servo_epipolar.sweeping.provenance import digest
from visual_servo_epipolar.sweeping.store import drive, FILE, Store
from visual_servo_epipolar.sweeping.summary import summaries
from visual_servo_epipolar.sweeping.workers import cluster_workers, local_workers


def run(options: argparse.Namespace) -> int:
    """Run what is missing, draw, write, print; return 0 unless a run raised."""
    require('matplotlib')
    if options.scheduler is not None:
        require('distributed', otherwise='leave out --scheduler')
    plan = _plan(options)
    folder = Path(options.out or Path('sweep_out', _name(plan)))
    with Store(folder, plan) as store:
        _work(plan, store, options)
        documents = summaries(plan, store)
    document = documents if options.compare else documents[plan.laws[0]]
    text, written = _report(documents, folder, field_of_view(plan.scenario.camera.camera))
    publish(document, f'{text}\n{written_to(folder, [FILE, *written])}', options.json)
    return _name_suspect_runs(plan, documents)


def _plan(options: argparse.Namespace) -> SweepPlan:
    if options.law and options.compare:
        raise InputError('--law and --compare exclude each other; give one of them')
    if options.scenes and (options.scene is not None or options.source != 'images'):
        raise InputError(
            '--scenes needs --source images and excludes --scene; leave one of them out'
        )
    scenario = scenario_of(options)
    return SweepPlan(
        region=options.region,
        runs=options.runs,
        source=options.source,
        laws=options.compare or (scenario.servo.law,),
        scenario=scenario,
        seed=options.seed,
        scenes=options.scenes or (),
        scenario_name=options.scenario,
        rig_name=options.rig,
    )


def _name(plan: SweepPlan) -> str:
    """Return the name of a folder, unique for the sweep and the version of the code."""
    identity = json.dumps([plan.identity(), digest()]).encode()
    mark = hashlib.sha256(identity).hexdigest()[:8]
    return '-'.join([plan.region, plan.source, *plan.laws, f'seed{plan.seed}', mark])


def _work(plan: SweepPlan, store: Store, options: argparse.Namespace) -> None:
    keys = plan.keys()
    earlier = [store.results[key] for key in keys if key in store.results]
    if earlier:
        print(
            f'visual_servo sweep: {len(earlier)} of {len(keys)} runs are in {store.path} already',
            file=sys.stderr,
        )
    if len(earlier) == len(keys):
        return
    with closing(Progress()) as progress:
        progress.say('starting workers ...')
        with (
            local_workers(options.jobs or cores())
            if options.scheduler is None
            else cluster_workers(options.scheduler)
        ) as workers:
            kinds, began = Counter(map(kind, earlier)), time.monotonic()

            def watch(results: Sequence[Mapping[str, Any]]) -> None:
                kinds.update(map(kind, results))
                ended, total = kinds.total(), len(keys)
                rate = (ended - len(earlier)) / (time.monotonic() - began)
                left = timedelta(seconds=round((total - ended) / rate))
                counts = '  '.join(f'{count} {name}' for name, count in kinds.items())
                progress.say(f'{ended}/{total}  {counts}  {rate:.2g} runs/s  {left} left')

            drive(plan, store, workers, watch)


def _report(
    documents: Mapping[str, Mapping[str, Any]], folder: Path, field_of_view: float
) -> tuple[str, list[str]]:
    """Write table and map into ``folder``; return the table, and the names of the files."""
    from visual_servo_epipolar.report.figures import save
    from visual_servo_epipolar.report.sweep_report import starts, table

    text = table(documents)
    write_whole(folder / 'table.md', f'{text}\n'.encode())
    save(starts(documents, field_of_view=field_of_view), folder / 'map.png')
    return text, ['table.md', 'map.png']


def _name_suspect_runs(plan: SweepPlan, documents: Mapping[str, Mapping[str, Any]]) -> int:
    """Name defects and silent wrongs with the commands that repeat them; return the exit code."""
    runs = [
        (law, index, run)
        for law, document in documents.items()
        for index, run in enumerate(document['runs'])
    ]
    for name, words in (('raised', 'raised'), ('wrong', 'arrived but wrong')):
        matching = [one for one in runs if kind(one[2]) == name]
        for law, index, run in matching[:SHOWN]:
            print(
                f'visual_servo sweep: {words} ({len(matching)} in all), {run["reason"]}: '
                f'{plan.command_of_run(law, index, run["start"])}',
                file=sys.stderr,
            )
    return 1 if any(kind(run) == 'raised' for *_, run in runs) else 0
