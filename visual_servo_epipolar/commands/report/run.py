"""``visual_servo report``: the page on a run of demo or simulate, on a bag, or on a route."""

from collections.abc import Mapping
import math
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from visual_servo_epipolar.commands.files.run_folder import versions
from visual_servo_epipolar.commands.report.tables import (
    parameter_section,
    phase_table,
    result_table,
    version_section,
)
from visual_servo_epipolar.core.servo.run_log import phase_spans, RunLog, seconds, summarise
from visual_servo_epipolar.report import figures
from visual_servo_epipolar.report.page import (
    figure_html,
    film,
    Headline,
    jpeg,
    linked_film,
    paragraph,
    Section,
    strip,
    write_page,
)
from visual_servo_epipolar.report.run_file import load_run
from visual_servo_epipolar.report.style import phase_label

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
