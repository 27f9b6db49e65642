"""``visual_servo sweep``: many starts through the closed loop, here or on a cluster."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
import hashlib
import json
from pathlib import Path
import sys
from typing import Any

from visual_servo_epipolar.commands.arguments import (
    add_run_options,
    law_expression,
    publish,
    scenario_of,
    seed,
)
from visual_servo_epipolar.commands.console import Progress, written_to
from visual_servo_epipolar.commands.files.output import write_whole
from visual_servo_epipolar.commands.sweep.progress import SweepProgress
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.nodes.startup.missing import require
from visual_servo_epipolar.processes import cores
from visual_servo_epipolar.simulation.regions import REGIONS
from visual_servo_epipolar.simulation.views import SOURCES
from visual_servo_epipolar.sweeping.cluster import cluster_workers
from visual_servo_epipolar.sweeping.drive import drive, Workers
from visual_servo_epipolar.sweeping.local import local_workers
from visual_servo_epipolar.sweeping.plan import Plan
from visual_servo_epipolar.sweeping.provenance import digest
from visual_servo_epipolar.sweeping.store import FILE, Store
from visual_servo_epipolar.sweeping.summary import defective, summaries, wrong

DEFAULT_FOLDER = 'sweep_out'
MAX_RUNS, MAX_SCENES = 1_000_000, 10_000
SHOWN = 3  # runs to look into that are named


def add_to(kinds: Any) -> None:
    """Add the subcommand."""
    parser = kinds.add_parser(
        'sweep',
        help='many starts through the closed loop: arrivals, errors, maps',
        description=__doc__,
        epilog='Runs are kept in DIR as they end. The same command, given again after it was '
        'interrupted or killed, goes on where it was; with more --runs it adds to them.',
    )
    parser.add_argument('--region', choices=REGIONS, required=True, help='where to start')
    parser.add_argument(
        '--runs', type=count, required=True, metavar='N', help='starts, for each law'
    )
    parser.add_argument(
        '--source',
        choices=SOURCES,
        default='features',
        help='what the servo sees: noisy point features, or rendered images (default features)',
    )
    add_run_options(parser)
    parser.add_argument(
        '--compare', type=laws, metavar='LAW,LAW', help='several laws from the same starts'
    )
    parser.add_argument(
        '--scenes', type=scenes, metavar='N-M', help='rooms to take turns in, such as 101-110'
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--jobs', type=count, metavar='J', help='worker processes (default one a core)'
    )
    where.add_argument(
        '--scheduler', metavar='ADDRESS', help='Dask scheduler to use, such as tcp://host:8786'
    )
    parser.add_argument(
        '--out',
        metavar='DIR',
        help=f'folder for runs, table and maps (default {DEFAULT_FOLDER}/ and a name made of '
        'the parameters)',
    )
    parser.set_defaults(run=sweep)


def count(text: str) -> int:
    """Parse a number of runs or of processes."""
    if not text.isdecimal() or not 1 <= int(text) <= MAX_RUNS:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 1 to {MAX_RUNS}')
    return int(text)


def laws(text: str) -> tuple[str, ...]:
    """Parse a list of laws, each once."""
    names = tuple(law_expression(name) for name in text.split(','))
    if len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f'{text!r} must list each law once')
    return names


def scenes(text: str) -> tuple[int, ...]:
    """Parse seeds of rooms: single ones and ranges, with commas between."""
    seeds: list[int] = []
    for part in text.split(','):
        first, dash, last = part.partition('-')
        ends = seed(first), seed(last if dash else first)
        if not 0 <= ends[1] - ends[0] < MAX_SCENES:
            raise argparse.ArgumentTypeError(f'{part!r} is not a range of up to {MAX_SCENES}')
        seeds += range(ends[0], ends[1] + 1)
    return tuple(seeds)


def sweep(options: argparse.Namespace) -> int:
    """Run what is missing, draw, write, print; return 0 unless a run raised."""
    require('matplotlib')
    if options.scheduler is not None:
        require('distributed', otherwise='leave out --scheduler')
    plan = _plan(options)
    folder = Path(options.out or Path(DEFAULT_FOLDER, _name(plan)))
    with Store(folder, plan) as store:
        _work(plan, store, options)
        documents = summaries(plan, store)
    document = documents if options.compare else documents[plan.laws[0]]
    text, written = _report(documents, folder, _field_of_view(plan))
    publish(document, f'{text}\n{written_to(folder, [FILE, *written])}', options.json)
    return _name_suspect_runs(plan, documents)


def _plan(options: argparse.Namespace) -> Plan:
    if options.law and options.compare:
        raise InputError('--law and --compare exclude each other; give one of them')
    if options.scenes and (options.scene is not None or options.source != 'images'):
        raise InputError('--scenes is for --source images, without --scene; leave one of them out')
    scenario = scenario_of(options)
    return Plan(
        region=options.region,
        runs=options.runs,
        source=options.source,
        laws=options.compare or (scenario.servo.law,),
        scenario=scenario,
        seed=options.seed,
        scenes=options.scenes or (),
        scenario_name=options.scenario,
    )


def _name(plan: Plan) -> str:
    """Return the name of a folder, unique for the sweep and the version of the code."""
    identity = json.dumps([plan.identity(), digest()]).encode()
    mark = hashlib.sha256(identity).hexdigest()[:8]
    return '-'.join([plan.region, plan.source, *plan.laws, f'seed{plan.seed}', mark])


def _work(plan: Plan, store: Store, options: argparse.Namespace) -> None:
    keys = plan.keys()
    earlier = [store.results[key] for key in keys if key in store.results]
    if earlier:
        print(
            f'visual_servo sweep: {len(earlier)} of {len(keys)} runs are in {store.path} already',
            file=sys.stderr,
        )
    if len(earlier) == len(keys):
        return
    progress = Progress()
    progress.say('starting workers ...')
    try:
        with _workers(options) as workers:
            sweep_progress = SweepProgress(len(keys), earlier)

            def watch(results: Sequence[Mapping[str, Any]]) -> None:
                sweep_progress.add(results)
                progress.say(sweep_progress.line())

            drive(plan, store, workers, watch)
    finally:
        progress.close()


def _workers(options: argparse.Namespace) -> AbstractContextManager[Workers]:
    if options.scheduler is not None:
        return cluster_workers(options.scheduler)
    return local_workers(options.jobs or cores())


def _field_of_view(plan: Plan) -> float:
    camera = plan.scenario.camera
    left, right = camera.camera.edges
    return right - left


def _report(
    documents: Mapping[str, Mapping[str, Any]], folder: Path, field_of_view: float
) -> tuple[str, list[str]]:
    """Write tables and figures into ``folder``; return the table, and the names of the files."""
    from visual_servo_epipolar.report import figures
    from visual_servo_epipolar.report.sweep import histogram, start_map
    from visual_servo_epipolar.report.sweep import table as tables

    text = tables.table(documents)
    for name, table in (('table.md', text), ('convergence.md', tables.convergence(documents))):
        write_whole(folder / name, f'{table}\n'.encode())
    where = start_map.starts(documents, field_of_view=field_of_view)
    figures.save(where, folder / 'map.png')
    figures.save(histogram.errors(documents), folder / 'histogram.png')
    return text, ['table.md', 'convergence.md', 'map.png', 'histogram.png']


def _name_suspect_runs(plan: Plan, documents: Mapping[str, Mapping[str, Any]]) -> int:
    """Name defects and silent wrongs with the commands that repeat them; return the exit code."""
    runs = [
        (law, index, run)
        for law, document in documents.items()
        for index, run in enumerate(document['runs'])
    ]
    for words, fits in (('raised', defective), ('arrived but wrong', wrong)):
        matching = [one for one in runs if fits(one[2])]
        for law, index, run in matching[:SHOWN]:
            print(
                f'visual_servo sweep: {words} ({len(matching)} in all), {run["reason"]}: '
                f'{plan.command_of_run(law, index, run["start"])}',
                file=sys.stderr,
            )
    return 1 if any(defective(run) for *_, run in runs) else 0
