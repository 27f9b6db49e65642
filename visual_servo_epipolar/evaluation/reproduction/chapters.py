"""The parts of the paper that can be reproduced: figures, statements, metrics; and their files."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.evaluation.reproduction import experiment, simulations
from visual_servo_epipolar.evaluation.reproduction.continuous import (
    metrics,
    Simulation1,
    Simulation2,
    simulation_1,
    simulation_2,
)
from visual_servo_epipolar.evaluation.reproduction.paper import (
    figure_data,
    markdown_of,
    plain,
    Statement,
    thin,
)
from visual_servo_epipolar.report.figures import save

Say = Callable[[str], None]


@dataclass(frozen=True)
class Chapter:
    """One part: figures by name, statements, metrics."""

    title: str
    figures: Mapping[str, Figure]
    statements: list[Statement]
    metrics: Mapping[str, Any] = field(default_factory=dict)
    succeeded: bool = True


def chapter_1(say: Say, runs: Simulation1 | None = None) -> Chapter:
    """Run simulation 1, unless these are its ``runs``, and draw figures 7 to 13."""
    say('simulation 1 ...')
    runs = runs or simulation_1()
    course = runs.course
    drawn = {
        'figure_07': simulations.epipoles(course, 7),
        'figure_08': simulations.velocities(course, 8),
        'figure_09': simulations.path(course, 9, 1),
        'figure_10': simulations.distance(course, 10),
        'figure_11': simulations.linear_velocity(course, 11),
        'figure_12': simulations.path(course, 12, 2),
        'figure_13': simulations.feature_motion(course, 13),
    }
    results = {
        'printed': metrics(course),
        'corrected': metrics(runs.corrected),
        'behind_printed': metrics(runs.behind_printed),
        'behind_corrected': metrics(runs.behind_corrected),
    }
    succeeded = course.outcome == runs.corrected.outcome == 'arrived'
    return Chapter(
        'Simulation 1: calibrated camera', drawn, simulations.claims_1(runs), results, succeeded
    )


def chapter_2(say: Say, runs: Simulation2 | None = None) -> Chapter:
    """Run simulation 2, unless these are its ``runs``, and draw figures 14 and 15."""
    say('simulation 2 ...')
    runs = runs or simulation_2()
    drawn = {
        'figure_14': simulations.epipoles(runs.course, 14),
        'figure_15': simulations.path(runs.course, 15, 1),
    }
    results = {name: metrics(getattr(runs, name)) for name in ('course', 'held', 'voted')}
    succeeded = runs.course.outcome == 'arrived'
    title = 'Simulation 2: partially calibrated camera'
    return Chapter(title, drawn, simulations.claims_2(runs), results, succeeded)


def chapter_3(say: Say) -> Chapter:
    """Run the experiment with images, draw figures 17 to 20."""
    run = experiment.experiment(say)
    drawn = {
        'figure_17': experiment.epipoles(run),
        'figure_18': experiment.difference(run),
        'figure_19': experiment.snapshots(run, 19),
        'figure_20': experiment.snapshots(run, 20),
    }
    summary = summarise(run.log)
    results = {
        'run': summary,
        'difference_rate_per_s': experiment.difference_decay(run.log).rate,
    }
    near = summary['position_error_m'] < experiment.ERROR_OF_THE_PAPER_M
    succeeded = summary['outcome'] == 'arrived' and near
    return Chapter('Experiment', drawn, experiment.claims(run), results, succeeded)


CHAPTERS: Mapping[str, Callable[[Say], Chapter]] = {
    'sim1': chapter_1,
    'sim2': chapter_2,
    'experiment': chapter_3,
}
POINTS = 60  # of each line that are written beside the figures


def publish(chapters: Mapping[str, Chapter], folder: Path) -> None:
    """Write every figure, its data (figures.json) and the table (table.md) into ``folder``."""
    for chapter in chapters.values():
        for name, figure in chapter.figures.items():
            save(figure, folder / f'{name}.png')
    (folder / 'figures.json').write_text(one_line_each(data(chapters)), encoding='utf-8')
    tables = [markdown_of(c.title, c.statements) for c in chapters.values()]
    (folder / 'table.md').write_text('\n'.join(tables), encoding='utf-8')


def data(chapters: Mapping[str, Chapter]) -> dict[str, Any]:
    """Return the data behind each figure, thinned."""
    return {
        name: thin(figure_data(figure), POINTS)
        for chapter in chapters.values()
        for name, figure in chapter.figures.items()
    }


def document(chapters: Mapping[str, Chapter]) -> dict[str, Any]:
    """Return the results of all chapters as JSON has them."""
    return {
        name: {
            'succeeded': chapter.succeeded,
            'numbers': chapter.metrics,
            'statements': [asdict(statement) for statement in chapter.statements],
        }
        for name, chapter in chapters.items()
    }


def text(chapters: Mapping[str, Chapter]) -> str:
    """Return the statements of all chapters for a terminal."""
    return '\n'.join(plain(c.title, c.statements) for c in chapters.values())


def one_line_each(figures: Mapping[str, Any]) -> str:
    """Return JSON with one line of text for each line of a figure."""
    blocks = []
    for name, lines in figures.items():
        rows = [f'  {json.dumps(key)}: {json.dumps(points)}' for key, points in lines.items()]
        blocks.append(f' {json.dumps(name)}: {{\n' + ',\n'.join(rows) + '\n }')
    return '{\n' + ',\n'.join(blocks) + '\n}\n'
