"""Report: an HTML page on a run or a bag."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, fields
from html import escape
import math
from pathlib import Path
from typing import Any

from visual_servo_epipolar.bags.replaying.replay import has_truth
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.outputs import OutputFolder
from visual_servo_epipolar.commands.replay import (
    compared_words,
    progress_watch,
    replay_bag,
    result_of,
)
from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.registry import phase_words
from visual_servo_epipolar.core.servo.run_log import RunLog, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of, Settings
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.files import made_folder
from visual_servo_epipolar.messages.settings_text import installed_versions
from visual_servo_epipolar.report import figures
from visual_servo_epipolar.report.page import (
    figure_html,
    FILE,
    Headline,
    Section,
    table,
    write_page,
)
from visual_servo_epipolar.report.run_file import FILE as RUN_FILE
from visual_servo_epipolar.report.run_file import load_run
from visual_servo_epipolar.simulation.scenario import Scenario


def run(options: argparse.Namespace) -> int:
    """Write the page; return 0 when it is there, whatever became of the run."""
    source = Path(options.bag)
    if source.name == RUN_FILE and source.is_file():
        source = source.parent
    is_run = (source / RUN_FILE).is_file()
    folder = Path(options.out or _default_folder(source, is_run))
    OutputFolder(folder).check()
    if is_run:
        _refuse_bag_options(options)
    with made_folder(folder):
        if is_run:
            report_run(source, folder / FILE)
        else:
            report_bag(options, folder / FILE)
    print(f'written: {folder / FILE}')
    return 0


def _default_folder(source: Path, is_run: bool) -> Path:
    """Return where the page goes: not into a bag, which is no place for other files."""
    if is_run:
        return source
    named = source if source.name not in ('', '..') else source.resolve()
    return named.with_name(f'{named.stem if named.is_file() else named.name}_report')


def _refuse_bag_options(options: argparse.Namespace) -> None:
    names = ('set', 'topics', 'namespace', 'desired', 'camera', 'tracks', 'repair')
    given = [f'--{name}' for name in names if getattr(options, name)]
    if given:
        raise InputError(
            f'{options.bag} is no bag: {", ".join(given)} cannot change what is in it; '
            'leave them out, or report on a bag'
        )


FOOTER = (
    'Plane of the paper: the goal lies in the origin and looks along +y; x to the right. Errors '
    'are against ground truth, which the servo never sees.'
)


def report_run(folder: Path, path: Path) -> None:
    """Write the page on the run in ``folder``; raises InputError if that fails."""
    run_file = load_run(folder)
    log = run_file.log
    result = summarise(log)
    sections = [
        Section('Result', result_table(result)),
        path_section(log),
        signals_section(log),
        Section('Phases', phase_table(result)),
        parameter_section(run_file.settings),
        version_section(run_file.versions),
    ]
    x, y, heading = log.start
    title = f'Run from x {x:g} m, y {y:g} m, heading {heading:+g} deg, law {log.law}'
    write_page(path, title, verdict_of(result), sections, footer=FOOTER)


def verdict_of(result: Mapping[str, Any]) -> Headline:
    """Return the verdict on a run: outcome, duration, errors."""
    arrived = result['outcome'] == 'arrived'
    text = f'{result["outcome"].capitalize()} after {result["duration_s"]:.1f} s'
    if result['position_error_m'] is not None and math.isfinite(result['position_error_m']):
        text += (
            f', {1e3 * result["position_error_m"]:.1f} mm and '
            f'{result["heading_error_deg"]:+.2f} deg from the goal'
        )
    return Headline(text, arrived, '' if arrived else result['reason'])


def path_section(log: RunLog) -> Section:
    """Return the map of a run with ground truth."""
    return Section('Path', figure_html(figures.trajectory(log), 'The path seen from above.'))


def signals_section(log: RunLog, recorded: FloatArray | None = None) -> Section:
    """Return the signals of a run; of a replay beside the ``recorded`` commands."""
    caption = 'What was measured and commanded. A dashed line marks where the run ended.'
    return Section('Signals', figure_html(figures.signals(log, recorded), caption))


def report_bag(options: argparse.Namespace, path: Path) -> None:
    """Write the page on a bag to ``path``; raises InputError if that fails."""
    with closing(Progress()) as progress:
        replayed = replay_bag(options, watch=progress_watch(progress))
    result = result_of(replayed, options)
    log = replayed.log
    compared = '\n'.join([*replayed.notes, *compared_words(result['comparison'])])
    last = {'servo': replayed.plan.servo, 'tracker': replayed.plan.tracker}
    sections = [
        Section('Result', result_table(result)),
        *([path_section(log)] if has_truth(replayed.run, replayed.steps) else []),
        Section('Recorded and replayed', f'<pre>{escape(compared)}</pre>'),
        signals_section(log, replayed.recorded_commands),
        Section('Phases', phase_table(result)),
        parameter_section({part: asdict(rows[-1][1]) for part, rows in last.items()}),
        version_section(replayed.versions['recorded']),
    ]
    bag = Path(options.bag)
    name = bag.name if bag.name != 'bag' else '/'.join(bag.parts[-2:])  # that of a demo
    title = f'Bag {name}, {len(replayed.steps)} steps from {result["source"]}'
    write_page(path, title, verdict_of(result), sections, footer=FOOTER)


QUANTITIES = (  # key, words, unit, factor to that unit
    ('position_error_m', 'distance from the goal', 'mm', 1e3),
    ('lateral_error_m', 'lateral error', 'mm', 1e3),
    ('longitudinal_error_m', 'longitudinal error', 'mm', 1e3),
    ('heading_error_deg', 'heading error', 'deg', 1.0),
    ('duration_s', 'duration', 's', 1.0),
    ('recorded_s', 'duration of the recording', 's', 1.0),
    ('path_length_m', 'length of the path', 'm', 1.0),
    ('max_distance_ratio', 'largest distance, of that at the start', '', 1.0),
    ('max_linear_speed', 'largest linear speed', 'm/s', 1.0),
    ('max_angular_speed', 'largest angular speed', 'rad/s', 1.0),
    ('min_visible_features', 'fewest features in view', '', 1),
    ('attempts', 'attempts', '', 1),
    ('seed', 'seed', '', 1),
)
KINDS: Mapping[str, type[Settings]] = {
    **{item.name: item.default_factory for item in fields(Scenario)},  # type: ignore[misc]
    'servo': ServoSettings,
    'tracker': TrackerSettings,
}


def result_table(result: Mapping[str, Any]) -> str:
    """Return the figures of a run with their units."""
    rows: list[Sequence[str | None]] = []
    for key, words, unit, factor in QUANTITIES:
        if key in result:
            value = result[key]
            known = f'{value * factor:.4g}' if isinstance(value, float) else _as_text(value)
            rows.append([words, known, unit])
    return table(['quantity', 'value', 'unit'], rows)


def phase_table(result: Mapping[str, Any]) -> str:
    """Return the phases of a run one after the other."""
    return table(
        ['from [s]', 'to [s]', 'phase', 'what it does'],
        [
            [
                *(f'{it[side]:.2f}' for side in ('start_s', 'end_s')),
                it['name'],
                phase_words(it['name']),
            ]
            for it in result['phases']
        ],
    )


def parameter_section(settings: Mapping[str, Mapping[str, Any]]) -> Section:
    """Return the settings that are not the default, part by part."""
    rows: list[Sequence[str | None]] = []
    for part, values in settings.items():
        for item in fields(KINDS[part]) if part in KINDS else ():
            value, default = _as_text(values.get(item.name, item.default)), _as_text(item.default)
            if value != default:
                rows.append([f'{part}.{item.name}', value, default, range_of(item).text])
    head = ['name', 'value', 'default', 'meaning [unit]']
    return Section('Parameters other than the default', table(head, rows))


def _as_text(value: Any) -> str:
    if value is None:
        return '\N{EN DASH}'
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(_as_text(item) for item in value) + ']'
    return str(value)


def version_section(ran_with: Mapping[str, str]) -> Section:
    """Return the versions that the run had, and those of this report."""
    rows: list[Sequence[str | None]] = [
        [name, ran_with.get(name), version] for name, version in installed_versions().items()
    ]
    return Section('Versions', table(['of', 'when it ran', 'of this report'], rows))
