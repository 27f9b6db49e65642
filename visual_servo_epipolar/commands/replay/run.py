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
from visual_servo_epipolar.bags.replaying.plan import Moment, plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import Plan, replay, Step, TrackedImage, Watch
from visual_servo_epipolar.bags.replaying.result import document, has_truth, run_log
from visual_servo_epipolar.commands.arguments import output_folder, write_json
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
class ReplayedBag:
    """Replayed bag: the recording, the steps of the replay, how they compare."""

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
        return run_log(self.run, self.steps, seed=servo.seed, law=servo.law_expression)


def replay_and_report(options: argparse.Namespace) -> bool:
    """Replay, print, write; return whether nothing differs from what was recorded."""
    progress = Progress()
    replayed = replay_bag(options, tolerance=options.tolerance, watch=progress_watch(progress))
    progress.close()
    result = result_of(replayed, options)
    if options.out is not None:
        from visual_servo_epipolar.report.figures import save

        folder = output_folder(options.out)
        write_json(result, str(folder / 'replay.json'))
        save(figure_of(replayed), folder / 'replay.png')
    if options.json != '-':
        print(in_words(result))
    write_json(result, options.json)
    return replayed.comparison.equal


def replay_bag(
    options: argparse.Namespace, *, tolerance: float | None = None, watch: Watch | None = None
) -> ReplayedBag:
    """Replay the bag in ``options``; by default recorded telemetry must be met exactly."""
    topics, changes = parse(options.topics), changes_of(options.set, options.params)
    camera = None if options.camera is None else read_camera(Path(options.camera))
    repairs = [str(repair(Path(options.bag)))] if options.repair else []
    start_s = time.perf_counter()
    with Bag(Path(options.bag)) as bag:
        run = read_run(bag, assigned(bag, topics))
        overrides = ReplayOverrides(
            from_tracks=options.tracks,
            camera=camera,
            desired=_desired(options.desired),
            changes=changes,
        )
        replay_plan, notes = plan(bag, run, overrides)
        steps = replay(bag, run, replay_plan, watch=watch)
    wall_s = time.perf_counter() - start_s
    if tolerance is None:
        tolerance = 0.0 if run.telemetry else math.inf
    return ReplayedBag(
        run=run,
        plan=replay_plan,
        steps=steps,
        comparison=compare(run, steps, tolerance),
        notes=[*repairs, *notes],
        wall_s=wall_s,
    )


def result_of(replayed: ReplayedBag, options: argparse.Namespace) -> dict[str, Any]:
    """Return the JSON document: that of a run, and the comparison."""
    return {
        **document(replayed.log, truth=has_truth(replayed.run, replayed.steps)),
        'bag': str(options.bag),
        'source': 'tracks' if replayed.plan.from_tracks else 'images',
        'steps': len(replayed.steps),
        'wall_s': replayed.wall_s,
        'changes': changes_of(options.set, options.params),
        'notes': replayed.notes,
        'comparison': as_document(replayed.comparison),
    }


def figure_of(replayed: ReplayedBag) -> 'Figure':
    """Return the figure of the recorded and the replayed run."""
    from visual_servo_epipolar.report.comparison import columns, comparison, PANELS, Signals

    names = [name for name, _ in PANELS]
    first = replayed.steps[0].key[0]
    times = np.array([seconds_between(first, item.key[0]) for item in replayed.steps])
    recorded_rows = recorded_steps(replayed.run, replayed.steps)
    recorded = Signals(
        times, [str(row.get('phase', '')) for row in recorded_rows], columns(recorded_rows, names)
    )
    replayed_rows = [item.telemetry for item in replayed.steps]
    phases = [item.phase.value for item in replayed.steps]
    divergence = replayed.comparison.divergence
    return comparison(
        recorded,
        Signals(times, phases, columns(replayed_rows, names)),
        None if divergence is None else divergence.time_s,
    )


def _desired(text: str | None) -> Image | Moment | None:
    """Return the photograph in a file, or the time of one in the bag."""
    if text is None:
        return None
    if Path(text).is_file():
        return read_photograph(Path(text))
    try:
        time_ns = round(float(text) * NANOSECONDS)
    except (OverflowError, ValueError):
        raise InputError(f'--desired must be an image file or a stamp [s], got {text!r}') from None
    return Moment(time_ns, since_first=text.startswith('+'))


def progress_watch(progress: Progress) -> Watch:
    """Return a callback that shows the progress of a replay."""

    def watch(step: Step, tracked: TrackedImage) -> None:
        progress.say(f'{step.key[0] / NANOSECONDS:.1f} s  {step.phase.value}')

    return watch
