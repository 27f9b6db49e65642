"""Tables of documents: aligned for a terminal, or Markdown for the pages of docs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray

Rows = Iterable[Sequence[str]]
Row = Mapping[str, Any]
Columns = Mapping[str, Callable[[Row], str]]  # by heads: what a row has there


def cells(columns: Columns, rows: Iterable[Row]) -> Rows:
    """Return what each row has in each column."""
    return ([cell(row) for cell in columns.values()] for row in rows)


def number(value: float | None, digits: int = 1, scale: float = 1.0) -> str:
    """Return ``scale * value``; a dash where there is none, as of runs of which none arrived."""
    if value is None or math.isnan(value):
        return '-'
    return f'{scale * value:.{digits}f}'


def numbers(values: Iterable[float | None], digits: int = 1, scale: float = 1.0) -> str:
    """Return several figures of one quantity, as median and p95."""
    return ' / '.join(number(value, digits, scale) for value in values)


def percentiles(values: Sequence[float] | FloatArray, *which: int, digits: int = 2) -> str:
    """Return percentiles of ``values``; one dash if there are no values."""
    return numbers(np.percentile(values, which).tolist(), digits) if len(values) else '-'


def aligned(head: str, rows: Rows, *, left: int = 1) -> list[str]:
    """Return a head such as ``law | time s`` and a line a row, the first columns ``left``."""
    lines = [head.split(' | '), *rows]
    sides = '<' * left + '>' * (len(lines[0]) - left)
    forms = [
        f'{side}{max(map(len, column))}'
        for side, column in zip(sides, zip(*lines, strict=True), strict=True)
    ]
    return ['  '.join(map(format, line, forms)).rstrip() for line in lines]


def markdown(head: str, rows: Rows) -> list[str]:
    """Return a head such as ``law | time [s]``, its rule and a line a row in Markdown."""
    lines = [' | '.join(cell.replace('|', '\\|') for cell in row) for row in rows]
    rule = '---|' * (head.count('|') + 1)
    return [f'| {head} |', f'|{rule}', *(f'| {line} |' for line in lines)]
