"""The replay behind ``visual_servo replay`` and ``visual_servo report``."""

import argparse
from dataclasses import dataclass
import math
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

import numpy as np

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run, Recording
from visual_servo_epipolar.bags.reading.topics import assigned, parse
from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.bags.replaying.comparison import (
    as_document,
    compare,
    Comparison,
    recorded_steps,
)
from visual_servo_epipolar.bags.replaying.plan import Moment, plan, Wishes
from visual_servo_epipolar.bags.replaying.replay import Plan, replay, Sighting, Step, Watch
from visual_servo_epipolar.bags.replaying.result import document, has_truth, run_log
from visual_servo_epipolar.commands.arguments import made_folder, write_json
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.files.camera import read_camera, read_photograph
from visual_servo_epipolar.commands.replay.settings import changes_of
from visual_servo_epipolar.commands.replay.text import in_words
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """A bag that was replayed: what was recorded, what came out, how they compare."""

    run: Recording
    plan: Plan
    steps: list[Step]
    comparison: Comparison
    notes: list[str]
    wall_s: float

    @property
    def log(self) -> RunLog:
        """The record of the replayed run."""
        servo = self.plan.servo[-1][1]
        return run_log(self.run, self.steps, seed=servo.seed, law=servo.law)


def replay_and_tell(options: argparse.Namespace) -> bool:
    """Replay, print, write; return whether nothing differs from what was recorded."""
    progress = Progress()
    done = replayed(options, tolerance=options.tolerance, watch=shown(progress))
    progress.close()
    result = result_of(done, options)
    if options.out is not None:
        from visual_servo_epipolar.report.figures import save

        folder = made_folder(options.out)
        write_json(result, str(folder / 'replay.json'))
        save(figure_of(done), folder / 'replay.png')
    if options.json != '-':
        print(in_words(result))
    write_json(result, options.json)
    return done.comparison.equal


def replayed(
    options: argparse.Namespace, *, tolerance: float | None = None, watch: Watch | None = None
) -> Replayed:
    """Replay the bag that ``options`` name; without a tolerance own bags must be met exactly."""
    told, changes = parse(options.topics), changes_of(options.set, options.params)
    camera = None if options.camera is None else read_camera(Path(options.camera))
    repaired = [str(repair(Path(options.bag)))] if options.repair else []
    began = time.perf_counter()
    with Bag(Path(options.bag)) as bag:
        run = read_run(bag, assigned(bag, told))
        wishes = Wishes(
            from_tracks=options.tracks,
            camera=camera,
            desired=_desired(options.desired),
            changes=changes,
        )
        made, notes = plan(bag, run, wishes)
        steps = replay(bag, run, made, watch=watch)
    wall_s = time.perf_counter() - began
    if tolerance is None:
        tolerance = 0.0 if run.numbers else math.inf
    return Replayed(
        run=run,
        plan=made,
        steps=steps,
        comparison=compare(run, steps, tolerance),
        notes=[*repaired, *notes],
        wall_s=wall_s,
    )


def result_of(done: Replayed, options: argparse.Namespace) -> dict[str, Any]:
    """Return the JSON document: that of a run, and the comparison."""
    return {
        **document(done.log, truth=has_truth(done.run, done.steps)),
        'bag': str(options.bag),
        'source': 'tracks' if done.plan.from_tracks else 'images',
        'steps': len(done.steps),
        'wall_s': done.wall_s,
        'changes': changes_of(options.set, options.params),
        'notes': done.notes,
        'comparison': as_document(done.comparison),
    }


def figure_of(done: Replayed) -> 'Figure':
    """Return the figure of what was recorded and what was replayed."""
    from visual_servo_epipolar.report.comparison import columns, comparison, PANELS, Track

    names = [name for name, _ in PANELS]
    first = done.steps[0].key[0]
    times = np.array([seconds_between(first, item.key[0]) for item in done.steps])
    before = recorded_steps(done.run, done.steps)
    recorded = Track(times, [str(row.get('phase', '')) for row in before], columns(before, names))
    now = [item.numbers for item in done.steps]
    phases = [item.phase.value for item in done.steps]
    parting = done.comparison.parting
    return comparison(
        recorded,
        Track(times, phases, columns(now, names)),
        None if parting is None else parting.time_s,
    )


def _desired(text: str | None) -> Image | Moment | None:
    """Return the photograph in a file, or when one in the bag was taken."""
    if text is None:
        return None
    if Path(text).is_file():
        return read_photograph(Path(text))
    try:
        time_ns = round(float(text) * NANOSECONDS)
    except (OverflowError, ValueError):
        raise InputError(f'--desired must be an image file or a stamp [s], got {text!r}') from None
    return Moment(time_ns, since_first=text.startswith('+'))


def shown(progress: Progress) -> Watch:
    """Return what shows how far the replay is."""

    def watch(done: Step, seen: Sighting) -> None:
        progress.say(f'{done.key[0] / NANOSECONDS:.1f} s  {done.phase.value}')

    return watch
