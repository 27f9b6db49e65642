"""Report on a bag: the recording, and its replay."""

import argparse
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from html import escape
from pathlib import Path

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.history import Happening
from visual_servo_epipolar.bags.replaying.replay import ReplayedStep, TrackedImage
from visual_servo_epipolar.bags.replaying.result import has_truth
from visual_servo_epipolar.commands.console import Progress
from visual_servo_epipolar.commands.files.run_folder import versions
from visual_servo_epipolar.commands.replay.run import (
    figure_of,
    progress_watch,
    replay_bag,
    ReplayedBag,
    result_of,
)
from visual_servo_epipolar.commands.replay.text import compared_words
from visual_servo_epipolar.commands.report.run import (
    caption_of,
    FOOTER,
    path_sections,
    sample_indices,
    verdict_of,
)
from visual_servo_epipolar.commands.report.tables import (
    parameter_section,
    phase_table,
    result_table,
    version_section,
)
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.servo.telemetry import sample
from visual_servo_epipolar.report.images.picture import picture
from visual_servo_epipolar.report.page import (
    Cell,
    figure_html,
    jpeg,
    paragraph,
    Section,
    strip,
    table,
    write_page,
)

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
    compared = compared_words(replayed.comparison_document, replayed.versions)
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
