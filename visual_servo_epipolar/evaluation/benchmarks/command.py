"""``visual_servo bench``: measure accuracy and speed, with other methods in the same run."""

import argparse
from collections.abc import Mapping
from contextlib import closing
import os
from pkgutil import resolve_name
from typing import Any

from visual_servo_epipolar.commands.arguments import add_flags, add_json, add_seed
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.outputs import write_json
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.nodes.startup.missing import remedy

# Each is a module with run(*, seed, quick, say) -> document and table(document) -> text.
BENCHMARKS: Mapping[str, str] = {
    name: f'visual_servo_epipolar.evaluation.benchmarks.{name}'
    for name in (
        *('estimation', 'tracking', 'laws', 'latency', 'calibration', 'ablation', 'consistency'),
        *('mounts', 'real', 'routes', 'report'),
    )
}
# Too long to be run unless they are named: what reads the FOLDER after the name of such a
# benchmark, by the option of its run that it becomes.
FOLDERS = {
    'real': ('photographs', f'{BENCHMARKS["real"]}:read_pairs'),
    'routes': ('clips', f'{BENCHMARKS["routes"]}:read_clips'),
    'report': ('out', 'builtins:str'),
}
USUAL = [name for name in BENCHMARKS if name not in FOLDERS]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.add_argument(
        'which',
        nargs='*',
        metavar='WHICH',
        type=os.path.expanduser,
        help=f'any of {", ".join(BENCHMARKS)} (default all but {", ".join(FOLDERS)}); after '
        'real and after routes the FOLDER with truth.json; after report the FOLDER that it writes '
        'and goes on in (default bench_report)',
    )
    add_flags(parser, {'--quick': 'run a few trials only, to see that it works'})
    add_seed(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the benchmarks one after the other, print their tables; return 0."""
    folders = {name: _folder(options.which, name) for name in FOLDERS}
    unknown = sorted(set(options.which) - set(BENCHMARKS))
    if unknown:
        raise InputError(
            f'unknown benchmark {", ".join(unknown)}; choose from {", ".join(BENCHMARKS)}'
        )
    results: dict[str, Any] = {}
    for name in options.which or USUAL:
        benchmark = _benchmark(name)
        with closing(Progress()) as progress:
            results[name] = benchmark.run(
                seed=options.seed,
                quick=options.quick,
                say=progress.say,
                **folders.get(name, {}),
            )
        if options.json != '-':
            print(benchmark.table(results[name]))
    write_json(results, options.json)
    return 0


def _folder(which: list[str], name: str) -> dict[str, Any]:
    """Return what the folder after ``name`` holds, by its option; it is taken out of ``which``."""
    if name not in which:
        return {}
    (option, reader), place = FOLDERS[name], which.index(name) + 1
    if place < len(which) and which[place] not in BENCHMARKS:
        return {option: resolve_name(reader)(which.pop(place))}
    if name == 'report':  # it has a folder of its own
        return {option: None}
    raise InputError(f'{name} must be followed by the FOLDER with its truth.json; name it')


def _benchmark(name: str) -> Any:
    try:
        return resolve_name(BENCHMARKS[name])
    except ImportError as error:
        raise InputError(f'benchmark {name} cannot be run: {remedy(error)}') from None
