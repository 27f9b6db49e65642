"""``visual_servo reproduce``: draw the paper's figures, and compare its statements with ours."""

import argparse
from contextlib import closing
from pathlib import Path

from visual_servo_epipolar import __version__
from visual_servo_epipolar.commands.arguments import add_json, add_words
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.outputs import OutputFolder, publish
from visual_servo_epipolar.files import all_at_once

PARTS = ('sim1', 'sim2', 'experiment')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.add_argument(
        'which', choices=(*PARTS, 'all'), help='simulation 1, simulation 2, experiment, or all'
    )
    out = {'--out DIR': 'folder for the figures and the table'}
    add_words(parser, out, required=True, type=OutputFolder)
    add_json(parser)
    parser.set_defaults(run=reproduce)


def reproduce(options: argparse.Namespace) -> int:
    """Run, draw, compare; return 0 if every run came to the end that the paper gives it."""
    # Only here: matplotlib takes a second to load, and the other commands need none of it.
    from visual_servo_epipolar.evaluation.reproduction.chapters import CHAPTERS, document, text
    from visual_servo_epipolar.evaluation.reproduction.chapters import publish as draw

    parts = PARTS if options.which == 'all' else (options.which,)
    with closing(Progress()) as progress:
        chapters = {part: CHAPTERS[part](progress.say) for part in parts}
    with all_at_once(Path(options.out)) as folder:
        draw(chapters, folder)
    words = f'{text(chapters)}\nfigures and table in {options.out}'
    publish({'version': __version__, **document(chapters)}, words, options.json)
    return int(not all(chapter.succeeded for chapter in chapters.values()))
