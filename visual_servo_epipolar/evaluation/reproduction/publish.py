"""Publication of the chapters: figures, the data behind them, the table."""

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any

from visual_servo_epipolar.evaluation.reproduction import statements
from visual_servo_epipolar.evaluation.reproduction.canvas import figure_data, thinned
from visual_servo_epipolar.evaluation.reproduction.chapters import Chapter
from visual_servo_epipolar.files import whole
from visual_servo_epipolar.report.figures import save

POINTS = 60  # of each line that are written beside the figures


def publish(chapters: Mapping[str, Chapter], folder: Path) -> None:
    """Write every figure, its data (figures.json) and the table (table.md) into ``folder``."""
    for chapter in chapters.values():
        for name, figure in chapter.figures.items():
            save(figure, folder / f'{name}.png')
    _write(folder / 'figures.json', one_line_each(data(chapters)))
    tables = [statements.markdown(c.title, c.statements) for c in chapters.values()]
    tables += [chapter.more for chapter in chapters.values() if chapter.more]
    _write(folder / 'table.md', '\n'.join(tables))


def data(chapters: Mapping[str, Chapter]) -> dict[str, Any]:
    """Return the data behind each figure, thinned."""
    return {
        name: thinned(figure_data(figure), POINTS)
        for chapter in chapters.values()
        for name, figure in chapter.figures.items()
    }


def document(chapters: Mapping[str, Chapter]) -> dict[str, Any]:
    """Return the results of all chapters as JSON has them."""
    return {
        name: {
            'succeeded': chapter.succeeded,
            'numbers': chapter.metrics,
            'statements': statements.document(chapter.statements),
        }
        for name, chapter in chapters.items()
    }


def text(chapters: Mapping[str, Chapter]) -> str:
    """Return the statements of all chapters for a terminal."""
    return '\n'.join(statements.plain(c.title, c.statements) for c in chapters.values())


def one_line_each(figures: Mapping[str, Any]) -> str:
    """Return JSON with one line of text for each line of a figure."""
    blocks = []
    for name, lines in figures.items():
        rows = [f'  {json.dumps(key)}: {json.dumps(points)}' for key, points in lines.items()]
        blocks.append(f' {json.dumps(name)}: {{\n' + ',\n'.join(rows) + '\n }')
    return '{\n' + ',\n'.join(blocks) + '\n}\n'


def _write(path: Path, content: str) -> None:
    """Write ``content`` to ``path``, whole or not at all."""
    with whole(path) as partial:
        partial.write_text(content, encoding='utf-8')
