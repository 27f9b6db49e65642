"""``visual_servo faults``: inject faults into closed loops; ground truth judges each run."""

import argparse
from collections.abc import Mapping
from contextlib import closing
import sys
from typing import Any

from visual_servo_epipolar.commands.arguments import (
    add_flags,
    add_json,
    add_seed,
    add_words,
    count,
)
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.outputs import publish
from visual_servo_epipolar.nodes.startup.missing import require
from visual_servo_epipolar.processes import cores


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        'The exit code is 0 only if every run is safe: the robot arrived right, or it stands and '
        'says why. --only and --seed repeat one run.'
    )
    numbers = {
        '--runs N': 'number of runs (default one per fault)',
        '--jobs J': 'worker processes (default one per core)',
    }
    add_words(parser, numbers, type=count)
    add_seed(parser)
    add_words(parser, {'--only NAME,...': 'inject these faults only'})
    add_flags(parser, {'--list': 'list the faults, and run nothing'})
    add_json(parser)
    parser.set_defaults(run=faults)


def faults(options: argparse.Namespace) -> int:
    """Run the campaign, print the table; return 0 if every verdict is safe."""
    require('rclpy')
    from visual_servo_epipolar.evaluation.faults import campaign
    from visual_servo_epipolar.evaluation.faults.table import FAULTS, TABLE

    if options.list:
        for verdict, rows in TABLE.items():
            for name, fault in rows.items():
                print(f'{name:<24} {verdict.value:<22} {fault.what}')
        return 0
    names = options.only.split(',') if options.only is not None else []
    number = options.runs or len(names or FAULTS)
    runs = campaign.plan(names, number, options.seed)
    with closing(Progress()) as progress:
        progress.say('starting workers ...')
        ended: list[bool] = []  # whether each was safe

        def watch(result: Mapping[str, Any]) -> None:
            ended.append(result['safe'])
            if not result['safe']:
                progress.close()
                print(campaign.offence(result), file=sys.stderr)
            progress.say(
                f'faults: {len(ended)} of {len(runs)}, {ended.count(False)} unsafe; '
                f'{result["fault"]}: {result["verdict"]}'
            )

        results = campaign.drive(runs, min(options.jobs or cores(), len(runs)), watch)
    document = campaign.document(results, options.seed)
    text = campaign.table(document)
    publish(document, text, options.json)
    if document['unsafe']:
        print(
            f'visual_servo faults: {document["unsafe"]} of {len(runs)} runs are unsafe',
            file=sys.stderr,
        )
    return 1 if document['unsafe'] else 0
