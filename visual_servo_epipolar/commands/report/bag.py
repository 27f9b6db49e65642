"""The report on a bag: what was recorded, and what its replay makes of it."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.replaying.comparison import as_document
from visual_servo_epipolar.bags.replaying.replay import Sighting, Step
from visual_servo_epipolar.bags.replaying.result import has_truth
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.files.run_folder import versions
from visual_servo_epipolar.commands.replay.run import (
    figure_of,
    Replayed,
    replayed,
    result_of,
    shown,
)
from visual_servo_epipolar.commands.replay.text import compared_words
from visual_servo_epipolar.commands.report.run import (
    caption_of,
    chosen,
    FOOTER,
    path_sections,
    verdict_of,
)
from visual_servo_epipolar.commands.report.tables import (
    parameter_section,
    phase_table,
    result_table,
    version_section,
)
from visual_servo_epipolar.core.geometry.camera import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.servo.telemetry import sample
from visual_servo_epipolar.report.images.picture import picture
from visual_servo_epipolar.report.page import drawn, jpeg, Section, strip, table, write_page

MOST_KEPT = 48


class Album:
    """Pictures of a replay as it goes: thinned out whenever they are too many."""

    def __init__(self) -> None:
        self._kept: dict[int, bytes] = {}
        self._stride, self._count, self._phase = 1, 0, ''

    def add(self, done: Step, seen: Sighting) -> None:
        """Take in one step, if it is due or begins a phase."""
        number, self._count = self._count, self._count + 1
        begins, self._phase = done.phase.value != self._phase, done.phase.value
        if seen.image is None or not isinstance(seen.camera, Camera):
            return
        if not begins and number % self._stride:
            return
        moment = sample(done.key[0], DESIRED_POSE, done.phase, done.numbers)
        self._kept[number] = jpeg(picture(seen.image, seen.features, moment, seen.camera))
        if len(self._kept) > MOST_KEPT:
            self._stride *= 2
            self._kept = {k: v for k, v in self._kept.items() if not k % self._stride}

    def nearest(self, wanted: Sequence[int]) -> dict[int, bytes]:
        """Return those pictures that come nearest to the steps ``wanted``."""
        if not self._kept:
            return {}
        numbers = {min(self._kept, key=lambda have: abs(have - want)) for want in wanted}
        return {number: self._kept[number] for number in sorted(numbers)}


def report_bag(options: argparse.Namespace, place: Callable[[], Path]) -> None:
    """Write the page on a bag where ``place`` says; raises InputError if it cannot be."""
    album, progress = Album(), Progress()
    show = shown(progress)

    def watch(done: Step, seen: Sighting) -> None:
        show(done, seen)
        album.add(done, seen)

    done = replayed(options, watch=watch)
    progress.close()
    result = result_of(done, options)
    log, truth = done.log, has_truth(done.run, done.steps)
    pictures = [
        (data, caption_of(log, number)) for number, data in album.nearest(chosen(log)).items()
    ]
    sections = [
        Section('Result', result_table(result)),
        *(path_sections(log) if truth else []),
        _comparison(done),
        *([Section('What was seen', strip(pictures))] if pictures else []),
        Section('Phases', phase_table(result)),
        parameter_section(
            {'servo': asdict(done.plan.servo[-1][1]), 'tracker': asdict(done.plan.tracker[-1][1])}
        ),
        _topics(Path(options.bag)),
        version_section(_recorded_versions(done), versions()),
    ]
    title = f'Bag {Path(options.bag).name}, {len(done.steps)} steps from {result["source"]}'
    write_page(place(), title, verdict_of(result), sections, footer=FOOTER)


def _comparison(done: Replayed) -> Section:
    lines = [*done.notes, *compared_words(as_document(done.comparison))]
    words = f'<pre>{escape(chr(10).join(lines))}</pre>'
    caption = 'Phases, epipoles and commands as recorded, and as replayed with these parameters.'
    return Section('Recorded and replayed', words + drawn(figure_of(done), caption))


def _recorded_versions(done: Replayed) -> dict[str, str]:
    said = [*done.run.servo, *done.run.tracker]
    found = {item.version for _, item in said if item.version}
    return {'visual_servo_epipolar': ', '.join(sorted(found))} if found else {}


def _topics(path: Path) -> Section:
    with Bag(path) as bag:
        rows = [[item.name, item.kind, item.count] for item in bag.topics.values()]
    return Section('Topics in the bag', table(['topic', 'type', 'messages'], rows))
