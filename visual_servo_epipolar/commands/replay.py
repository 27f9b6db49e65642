"""The replay behind ``visual_servo replay`` and ``visual_servo report``, and its text."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields
from functools import cached_property
import math
from pathlib import Path
import time
from typing import Any

import numpy as np
import yaml

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run, Recording
from visual_servo_epipolar.bags.reading.topics import assign_roles, camera_notes, parse
from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.bags.replaying.comparison import (
    as_document,
    COMMANDS,
    compare,
    Comparison,
    recorded_steps,
)
from visual_servo_epipolar.bags.replaying.plan import Moment, plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import (
    document,
    has_truth,
    Plan,
    record,
    replay,
    ReplayedStep,
    Watch,
)
from visual_servo_epipolar.commands.camera_files import read_camera, read_photograph
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.outputs import publish, write_json
from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.errors import InputError, SHOWN
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.files import all_at_once
from visual_servo_epipolar.messages.settings_text import installed_versions

Changes = dict[str, dict[str, Any]]

KINDS: Mapping[str, type[Settings]] = {'servo': ServoSettings, 'tracker': TrackerSettings}


def changes_of(words: Sequence[str]) -> Changes:
    """
    Return settings by section.

    Raises InputError if a word is not SECTION.NAME=VALUE. The values are not checked.
    """
    changes: Changes = {}
    for word in words:
        name, equals, value = word.partition('=')
        section, dot, setting = name.partition('.')
        if not (equals and dot and setting and section in KINDS):
            raise InputError(
                f'--set takes SECTION.NAME=VALUE with a section of {", ".join(KINDS)}, as in '
                f'servo.k1=0.1, got {word!r}{_suggestion(setting if dot else section)}'
            )
        changes.setdefault(section, {})[setting] = _value(value)
    return changes


def _suggestion(setting: str) -> str:
    """Return in words how to write a setting without its section, if there is one."""
    for section, kind in KINDS.items():
        if setting in {item.name for item in fields(kind)}:
            return f'; did you mean {section}.{setting}?'
    return ''


def _value(text: str) -> Any:
    """Return what YAML makes of ``text``; 1e-3, a word to YAML, is a number as well."""
    try:
        value = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, AttributeError, RecursionError):
        return text
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            pass
    return value


@dataclass(frozen=True, kw_only=True)
class ReplayedBag:
    """
    Replayed bag: the recording, the steps of the replay, how they compare.

    ``given`` are the settings that the user gave.
    """

    run: Recording
    plan: Plan
    given: Changes
    steps: list[ReplayedStep]
    comparison: Comparison
    notes: list[str]
    wall_s: float

    @cached_property
    def log(self) -> RunLog:
        """The record of the replayed run."""
        return record(self.run, self.steps, self.plan)

    @property
    def recorded_commands(self) -> FloatArray:
        """The recorded command of each sample of the log, shape (N, 2), nan where none is."""
        rows = recorded_steps(self.run, self.steps)[: len(self.log.samples)]
        return np.array([[row.get(it, math.nan) for it in COMMANDS] for row in rows], np.float64)

    @property
    def versions(self) -> dict[str, dict[str, str]]:
        """The versions that computed: when recording, where the bag says so, and replaying."""
        recorded: dict[str, dict[str, None]] = {}
        for _, settings in (*self.run.servo, *self.run.tracker):
            for name, version in settings.versions.items():
                recorded.setdefault(name, {})[version] = None
        named = {name: ', '.join(versions) for name, versions in recorded.items()}
        return {'recorded': named, 'replayed': installed_versions()}


def run(options: argparse.Namespace) -> int:
    """Replay, print, write; return 0 if nothing differs from what was recorded."""
    with closing(Progress()) as progress:
        replayed = replay_bag(options, tolerance=options.tolerance, watch=progress_watch(progress))
    result = result_of(replayed, options)
    if options.out is not None:
        from visual_servo_epipolar.report.figures import save, signals

        with all_at_once(Path(options.out)) as folder:
            save(signals(replayed.log, replayed.recorded_commands), folder / 'replay.png')
            write_json(result, str(folder / 'replay.json'))
    publish(result, in_words(result), options.json)
    return 0 if replayed.comparison.equal else 1


def replay_bag(
    options: argparse.Namespace, *, tolerance: float | None = None, watch: Watch | None = None
) -> ReplayedBag:
    """Replay the bag in ``options``; by default recorded telemetry must be met exactly."""
    topics, given = parse(options.topics), changes_of(options.set)
    kind = {'rectified': options.rectified, 'cropped': options.cropped}
    report = repair(Path(options.bag)) if options.repair else None
    start_s = time.perf_counter()
    path = report.path if report else Path(options.bag)
    with Bag(path, repaired=report is not None) as bag:
        namespace = options.namespace and f'/{options.namespace.strip("/")}'
        run = read_run(bag, assign_roles(bag, topics, namespace), namespace)
        overrides = ReplayOverrides(
            from_tracks=options.tracks,
            camera=None if options.camera is None else read_camera(options.camera, **kind),
            **kind,
            desired=_goal_of(options.desired),
            changes=given,
        )
        replay_plan, notes = plan(bag, run, overrides)
        if options.camera is None:
            notes = [*camera_notes(bag, run.topics, topics), *notes]
        steps = replay(bag, run, replay_plan, watch=watch)
    wall_s = time.perf_counter() - start_s
    if tolerance is None:
        tolerance = 0.0 if run.telemetry else math.inf
    return ReplayedBag(
        run=run,
        plan=replay_plan,
        given=given,
        steps=steps,
        comparison=compare(run, steps, tolerance),
        notes=[*([str(report)] if report else []), *bag.notes, *notes],
        wall_s=wall_s,
    )


def result_of(replayed: ReplayedBag, options: argparse.Namespace) -> dict[str, Any]:
    """Return the JSON document: that of a run, and the comparison."""
    return {
        **document(replayed.log, truth=has_truth(replayed.run, replayed.steps)),
        'bag': str(options.bag),
        'source': 'tracks' if replayed.plan.from_tracks else 'images',
        'steps': len(replayed.steps),
        # From the first step to the last, however early the run ended.
        'recorded_s': seconds_between(*(replayed.steps[k].key[0] for k in (0, -1))),
        'wall_s': replayed.wall_s,
        'changes': replayed.given,
        'notes': replayed.notes,
        'versions': replayed.versions,
        'comparison': as_document(replayed.comparison),
    }


def _goal_of(text: str | None) -> Image | Moment | None:
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

    def watch(step: ReplayedStep) -> None:
        progress.say(f'{step.key[0] / NANOSECONDS:.1f} s  {step.phase.value}')

    return watch


COMPARED = (
    'phase',
    'linear_m_s',
    'angular_rad_s',
    'epipole_current_px',
    'epipole_desired_px',
    'bearing_current_rad',
    'bearing_desired_rad',
    'feature_difference_px2',
)


def in_words(result: Mapping[str, Any]) -> str:
    """Return the result of a replay and its comparison as text."""
    duration_s, wall_s = result['recorded_s'], result['wall_s']
    lines = [
        f'{result["steps"]} steps from {result["source"]}, {duration_s:.1f} s replayed in '
        f'{wall_s:.1f} s ({duration_s / wall_s:.1f} x real time)'
    ]
    lines += [
        f'  {section}.{name} = {value}'
        for section, values in result['changes'].items()
        for name, value in values.items()
    ]
    lines += [f'  note: {note}' for note in result['notes']]
    lines += [
        f'  {phase["start_s"]:6.1f} - {phase["end_s"]:6.1f} s  {phase["name"]}'
        for phase in result['phases']
    ]
    end_s = result['phases'][-1]['end_s']
    if duration_s > end_s:
        lines.append(f'  {result["outcome"]}; the recording goes on to {duration_s:.1f} s')
    return '\n'.join([*lines, *compared_words(result['comparison'])])


def compared_words(comparison: Mapping[str, Any]) -> list[str]:
    """Return the comparison of recorded and replayed, line by line."""
    steps, tolerance = comparison['compared_steps'], comparison['tolerance']
    if not steps:
        return ['nothing was recorded to compare with']
    lines = []
    if missing := comparison['missing_steps']:
        lines.append(f'{missing} recorded steps have no image in the bag')
    if unpublished := comparison['unheard_commands']:
        lines.append(f'{unpublished} replayed commands were not published then')
    if first := comparison['parting']:
        lines.append(
            f'recorded and replayed diverge at {first["time_s"]:.3f} s, '
            f'stamp {first["stamp_ns"]} ns:'
        )
        parted, rank = first['quantities'], dict(zip(COMPARED, range(len(COMPARED)), strict=True))
        lines += [
            f'  {name}: recorded {parted[name]["recorded"]}, replayed {parted[name]["replayed"]}'
            for name in sorted(parted, key=lambda name: rank.get(name, len(rank)))[:SHOWN]
        ]
    else:
        how = f'the same within {tolerance:g}' if tolerance < math.inf else 'beside each other'
        how = 'the same to the last bit' if tolerance == 0.0 else how
        lines.append(f'recorded and replayed: {steps} steps, {how}')
    rows = comparison['differences']
    differing = [
        it for it in COMPARED if it in rows and (rows[it]['largest'] or rows[it]['apart'])
    ]
    if differing:
        lines.append(f'{"quantity":<24}{"steps apart":>12}{"largest":>12}{"rms":>12}')
        for name in differing:
            size = '' if name == 'phase' else '{largest:>12.3g}{rms:>12.3g}'.format(**rows[name])
            lines.append(f'{name:<24}{rows[name]["apart"]:>12}{size}')
    return lines
