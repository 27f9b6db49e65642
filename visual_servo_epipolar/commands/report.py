"""Report: an HTML page on a run, a bag or a route."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, fields
from html import escape
import math
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import Happening
from visual_servo_epipolar.bags.replaying.comparison import as_document
from visual_servo_epipolar.bags.replaying.replay import has_truth, ReplayedStep, TrackedImage
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.outputs import OutputFolder
from visual_servo_epipolar.commands.replay import (
    compared_words,
    figure_of,
    progress_watch,
    replay_bag,
    ReplayedBag,
    result_of,
)
from visual_servo_epipolar.commands.simulate import versions
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.registry import phase_words
from visual_servo_epipolar.core.routes.chain import path_poses, seam
from visual_servo_epipolar.core.routes.route import Bridge, Route
from visual_servo_epipolar.core.servo.run_log import phase_spans, RunLog, seconds, summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.telemetry import sample
from visual_servo_epipolar.core.settings import range_of, Settings
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.files import made_folder
from visual_servo_epipolar.messages.route_folder import folder_bytes, is_route, read_route
from visual_servo_epipolar.report import figures
from visual_servo_epipolar.report.canvas import GREY, new_figure
from visual_servo_epipolar.report.images.video import picture
from visual_servo_epipolar.report.page import (
    Cell,
    figure_html,
    FILE,
    film,
    folded_html,
    Headline,
    jpeg,
    linked_film,
    paragraph,
    Section,
    strip,
    table,
    write_page,
)
from visual_servo_epipolar.report.run_file import FILE as RUN_FILE
from visual_servo_epipolar.report.run_file import load_run
from visual_servo_epipolar.report.style import INK, phase_label
from visual_servo_epipolar.simulation.scenario import Scenario


def report(options: argparse.Namespace) -> int:
    """Write the page; return 0 when it is there, whatever became of the run."""
    source = Path(options.bag)
    if source.name == RUN_FILE and source.is_file():
        source = source.parent
    is_run, is_taught = (source / RUN_FILE).is_file(), is_route(source)
    folder = Path(options.out or _default_folder(source, is_run))
    OutputFolder(folder).check()
    if is_run or is_taught:
        _refuse_bag_options(options)
    with made_folder(folder):
        if is_run:
            report_run(source, folder / FILE)
        elif is_taught:
            report_route(source, folder / FILE)
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
    names = ('set', 'params', 'topics', 'namespace', 'desired', 'camera', 'tracks', 'repair')
    given = [f'--{name}' for name in names if getattr(options, name)]
    if given:
        raise InputError(
            f'{options.bag} is no bag: {", ".join(given)} cannot change what is in it; '
            'leave them out, or report on a bag'
        )


MOST_PICTURES = 12
VIDEOS = ('video.webm', 'video.mp4', 'video.avi')
SIGNALS = (
    'What was measured and commanded. A dashed line marks where the run ended. The estimate d_hat '
    'is no measurement: it begins at initial_distance, an upper bound, is carried on by the '
    'commands, and scales the speed of step 1, which works while it is not below the distance d.'
)
FOOTER = (
    'Plane of the paper: the goal lies in the origin and looks along +y; x to the right. Errors '
    'are against ground truth, which the servo never sees.'
)
EMBEDDED_BYTES = 8_000_000  # largest video that a page holds; a mail takes about 20 MB
MIME = {'.mp4': 'video/mp4', '.webm': 'video/webm'}
IN_BROWSERS = ('h264', 'avc1', 'VP80', 'VP90', 'vp09', 'AV01', 'av01')  # as OpenCV names them


def report_run(folder: Path, path: Path) -> None:
    """Write the page on the run in ``folder``; raises InputError if that fails."""
    run_file = load_run(folder)
    log = run_file.log
    result = summarise(log)
    sections = [
        Section('Result', result_table(result)),
        *path_sections(log),
        *_pictures_section(folder, path, log),
        Section('Phases', phase_table(result)),
        parameter_section(run_file.settings),
        version_section(run_file.versions, versions()),
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


def path_sections(log: RunLog) -> list[Section]:
    """Return the map and the signals of a run with ground truth."""
    return [
        Section('Path', figure_html(figures.trajectory(log), 'The path seen from above.')),
        Section('Signals', figure_html(figures.signals(log), SIGNALS)),
    ]


def sample_indices(log: RunLog) -> list[int]:
    """Return the indices of samples to picture: where phases begin, and evenly in between."""
    times = seconds(log)
    starts = [int(np.searchsorted(times, span.start_s)) for span in phase_spans(log)]
    starts = sorted({*starts, len(times) - 1})[-MOST_PICTURES:]
    even = np.linspace(0, len(times) - 1, MOST_PICTURES - len(starts) + 2)[1:-1]
    return sorted({*starts, *even.round().astype(int).tolist()})


def caption_of(log: RunLog, number: int) -> str:
    """Return time and phase of a sample."""
    return f'{seconds(log)[number]:.1f} s, {phase_label(log.samples[number].phase.value)}'


def _pictures_section(folder: Path, page: Path, log: RunLog) -> list[Section]:
    """Return the video of the run and pictures from it, where there is one."""
    video = next((folder / name for name in VIDEOS if (folder / name).is_file()), None)
    if video is None:
        return []
    pictures = _pictures(video, log)
    stills = strip(pictures, wide=True) if pictures else ''
    return [Section('What was seen', shown_video(video, page) + stills)]


def _pictures(video: Path, log: RunLog) -> list[tuple[bytes, str]]:
    capture = cv2.VideoCapture(str(video))
    count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    wanted = {_frame_of(number, len(log.samples), count): number for number in sample_indices(log)}
    pictures: list[tuple[bytes, str]] = []
    for frame in range(count):
        success, picture = capture.read()
        if not success:
            break
        if frame in wanted:
            pictures.append((jpeg(picture), caption_of(log, wanted[frame])))
    capture.release()
    return pictures


def _frame_of(number: int, samples: int, frames: int) -> int:
    """Return the frame of a video that shows a sample, whatever its stride was."""
    return round(number * max(frames - 1, 0) / max(samples - 1, 1))


def shown_video(video: Path, page: Path) -> str:
    """Return ``video`` as HTML for ``page``, or a sentence where no browser plays it."""
    codec, size = codec_of(video), video.stat().st_size
    if codec not in IN_BROWSERS:
        return paragraph(
            f'{video.name} ({codec or "unknown codec"}) plays in no browser: open it in a video '
            'player, or drive again where PyAV is installed.'
        )
    if size <= EMBEDDED_BYTES:
        caption = f'The whole run, {size / 1e6:.1f} MB inside this page.'
        return film(video.read_bytes(), MIME[video.suffix], caption)
    link = Path(os.path.relpath(video, page.parent)).as_posix()
    caption = f'The whole run, {size / 1e6:.1f} MB, not inside this page: it is loaded from {link}'
    return linked_film(quote(link), caption)


def codec_of(video: Path) -> str:
    """Return the four letters of the codec of a video; empty if it cannot be read."""
    capture = cv2.VideoCapture(str(video))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) if capture.isOpened() else 0
    capture.release()
    letters = max(code, 0).to_bytes(4, 'little')
    return letters.decode('ascii', 'replace').strip('\0')


MOST_KEPT = 48


class SampledPictures:
    """Sampled pictures of a replay: thinned out whenever they are too many."""

    def __init__(self) -> None:
        self._kept: dict[int, bytes] = {}
        self._stride, self._count, self._phase = 1, 0, ''

    def add(self, step: ReplayedStep, tracked: TrackedImage) -> None:
        """Add the picture of a step, if it is due or begins a phase."""
        number, self._count = self._count, self._count + 1
        begins, self._phase = step.phase.value != self._phase, step.phase.value
        if tracked.image is None or isinstance(tracked.camera, str):
            return
        if not begins and number % self._stride:
            return
        shown_sample = sample(step.key[0], DESIRED_POSE, step.phase, step.telemetry)
        self._kept[number] = jpeg(
            picture(tracked.image, tracked.features, shown_sample, tracked.camera)
        )
        if len(self._kept) > MOST_KEPT:
            self._stride *= 2
            self._kept = {k: v for k, v in self._kept.items() if not k % self._stride}

    def nearest(self, wanted: Sequence[int]) -> dict[int, bytes]:
        """Return the pictures that come nearest to the steps ``wanted``."""
        if not self._kept:
            return {}
        indices = {min(self._kept, key=lambda kept: abs(kept - index)) for index in wanted}
        return {number: self._kept[number] for number in sorted(indices)}


def report_bag(options: argparse.Namespace, path: Path) -> None:
    """Write the page on a bag to ``path``; raises InputError if that fails."""
    pictures = SampledPictures()
    with closing(Progress()) as progress:
        show = progress_watch(progress)

        def watch(step: ReplayedStep, tracked: TrackedImage) -> None:
            show(step, tracked)
            pictures.add(step, tracked)

        replayed = replay_bag(options, watch=watch)
    result = result_of(replayed, options)
    log, has_ground_truth = replayed.log, has_truth(replayed.run, replayed.steps)
    captioned = [
        (data, caption_of(log, number))
        for number, data in pictures.nearest(sample_indices(log)).items()
    ]
    sections = [
        Section('Result', result_table(result)),
        *(path_sections(log) if has_ground_truth else []),
        _comparison(replayed),
        *([Section('What was seen', strip(captioned))] if captioned else []),
        Section('Phases', phase_table(result)),
        history_section(replayed.history),
        parameter_section(
            {
                'servo': asdict(replayed.plan.servo[-1][1]),
                'tracker': asdict(replayed.plan.tracker[-1][1]),
            }
        ),
        _topics(Path(options.bag)),
        version_section(replayed.versions['recorded'], versions()),
    ]
    bag = Path(options.bag)
    name = bag.name if bag.name != 'bag' else '/'.join(bag.parts[-2:])  # that of a demo
    title = f'Bag {name}, {len(replayed.steps)} steps from {result["source"]}'
    write_page(path, title, verdict_of(result), sections, footer=FOOTER)


def _comparison(replayed: ReplayedBag) -> Section:
    compared = compared_words(as_document(replayed.comparison))
    lines = [*replayed.notes, *compared]
    words = f'<pre>{escape(chr(10).join(lines))}</pre>'
    caption = 'Phases, epipoles and commands as recorded, and as replayed with these parameters.'
    return Section('Recorded and replayed', words + figure_html(figure_of(replayed), caption))


def history_section(history: Sequence[Happening]) -> Section:
    """Return what was ordered and set on the way, one after the other."""
    if not history:
        body = paragraph('no service was called and no setting changed while this was recorded')
        return Section('Events', body)
    rows: list[Sequence[Cell]] = [
        (
            'before any image' if item.time_s is None else f'{item.time_s:.2f}',
            item.node,
            item.what + (f': {item.reason}' if item.reason else ''),
        )
        for item in history
    ]
    return Section('Events', table(['after [s]', 'node', 'what happened'], rows))


def _topics(path: Path) -> Section:
    with Bag(path) as bag:
        rows: list[Sequence[Cell]] = [
            (item.name, item.kind, item.count) for item in bag.topics.values()
        ]
    return Section('Topics in the bag', table(['topic', 'type', 'messages'], rows))


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
    rows: list[Sequence[Cell]] = []
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
                f'{item["start_s"]:.2f}',
                f'{item["end_s"]:.2f}',
                item['name'],
                phase_words(item['name']),
            ]
            for item in result['phases']
        ],
    )


def parameter_section(settings: Mapping[str, Mapping[str, Any]]) -> Section:
    """Return the settings part by part; those that are not the default stand out."""
    parts = [_parameters(part, values) for part, values in settings.items()]
    return Section('Parameters', '\n'.join(parts) or '<p>none were recorded</p>')


def _parameters(part: str, values: Mapping[str, Any]) -> str:
    known = {item.name: item for item in fields(KINDS[part])} if part in KINDS else {}
    rows, changed = [], []
    for name, value in values.items():
        default, meaning = None, ''
        if name in known:
            default, meaning = known[name].default, range_of(known[name]).text
        rows.append([name, _as_text(value), _as_text(default), meaning])
        changed.append(default is not None and _as_text(value) != _as_text(default))
    title = f'{part}: {sum(changed)} of {len(values)} other than the default'
    head = ['name', 'value', 'default', 'meaning [unit]']
    return folded_html(title, table(head, rows, changed=changed))


def _as_text(value: Any) -> str:
    if value is None:
        return '\N{EN DASH}'
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(_as_text(item) for item in value) + ']'
    return str(value)


def version_section(ran_with: Mapping[str, str], made_with: Mapping[str, str]) -> Section:
    """Return the versions that the run had, and those of this report."""
    rows: list[Sequence[Cell]] = [
        [name, ran_with.get(name, '\N{EN DASH}'), made_with.get(name, '\N{EN DASH}')]
        for name in dict.fromkeys([*ran_with, *made_with])
    ]
    return Section('Versions', table(['of', 'when it ran', 'of this report'], rows))


MAP = (
    'The taught path in axes of the first photograph, x ahead of it and y to its left, as the '
    'photographs were chained; dots are key views, squares stations. Metres are those of the '
    'odometry.'
)
NEAREST = 0.1  # depth of a feature in the map, inverted [1/m]: those beyond 10 m are left out


def report_route(folder: Path, path: Path) -> None:
    """Write the page on the route in ``folder``; raises InputError if that fails."""
    route = read_route(folder)
    size_mb = 1e-6 * folder_bytes(folder)
    seams = seam(route.views)
    verdict = Headline(
        f'{route.length:.2f} m, {len(route.views)} key views, {len(route.stations)} stations',
        good=True,
        more=f'{size_mb:.1f} MB, {1e3 * size_mb / max(route.length, 1e-3):.0f} kB a metre; '
        f'neighbours disagree on the path by {1e3 * np.sqrt(np.nanmean(seams**2)):.2f} mm rms, '
        f'{1e3 * np.nanmax(seams):.2f} mm at most',
    )
    sections = [
        Section('Map', figure_html(route_map(route), MAP)),
        Section('Photographs', strip(list(_photographs(route)))),
        Section('Key views', folded_html('all of them', _key_views(route, seams.tolist()))),
    ]
    write_page(path, f'Route {folder.resolve().name}', verdict, sections)


def route_map(route: Route) -> Figure:
    """Return the taught path with its key views, and the features they know."""
    figure = new_figure(7.0, 6.0)
    axes = figure.subplots()
    points = np.concatenate([_features(route, k) for k in range(len(route.views))])
    axes.plot(*points.T, '.', color=GREY, markersize=1.0, alpha=0.5, label='features')
    path = np.array(list(path_poses(route)))
    axes.plot(path[:, 0], path[:, 1], color=INK, lw=1.6, label='taught path')
    poses = np.array([view.pose for view in route.views])
    axes.plot(poses[:, 0], poses[:, 1], 'o', color='#0072B2', markersize=4.0, label='key view')
    ends = poses[route.stations]
    axes.plot(ends[:, 0], ends[:, 1], 's', color='#D55E00', markersize=7.0, label='station')
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend(loc='best')
    return figure


def _features(route: Route, number: int) -> np.ndarray:
    """Return where the features of a key view are in the plane, (N, 2), but distant ones."""
    view = route.views[number]
    anchors = view.structure.anchors(route.camera).structure
    near = anchors.inverse_depth > NEAREST
    right, _, ahead = anchors.rays[:, near] / anchors.inverse_depth[near]
    x, y, theta = view.pose
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.stack([x + cosine * ahead + sine * right, y + sine * ahead - cosine * right], axis=1)


def _photographs(route: Route) -> Iterator[tuple[bytes, str]]:
    for number, view in enumerate(route.views):
        station = ', a station' if view.is_station else ''
        yield jpeg(view.image), f'{number}: after {view.way:.2f} m{station}'


def _key_views(route: Route, seams: list[float]) -> str:
    rows = [
        (
            number,
            view.way,
            len(view.structure),
            float(1.0 / np.median(np.maximum(view.structure.inverse_depth, 1e-3))),
            None if disagreement is None else 1e3 * disagreement,
            'yes' if view.is_station else '',
            'no' if view.bridge is None else _bridge_words(view.bridge),
        )
        for number, (view, disagreement) in enumerate(
            zip(route.views, [*seams, None], strict=True)
        )
    ]
    head = (
        'number',
        'way [m]',
        'features',
        'median depth [m]',
        'seam to the next [mm]',
        'station',
        'bridged by odometry',
    )
    return table(head, rows)


def _bridge_words(bridge: Bridge) -> str:
    turn, deviation = math.degrees(bridge.turn), 1e3 * bridge.deviation
    return f'{bridge.way:.2f} m, {turn:+.0f} deg, to {deviation:.0f} mm'
