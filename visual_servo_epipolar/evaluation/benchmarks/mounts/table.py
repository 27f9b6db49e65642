"""The document of the bench of mounts as Markdown: one table a group, one row a camera."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

GROUPS = {
    'attitude': 'tilt (down positive) and roll (clockwise)',
    'yaw': 'yaw (left positive) and place, ahead and left of the axle',
    'worse': 'worse, with a right wheel 1 % larger',
    'size': 'image size [px], field of view 79.5 deg',
    'lens': 'lens',
}
HEAD = (
    '| arrived | wrong | position, median / p95 [mm] | heading p95 [deg] '
    '| excursion, p95 / max | wrong geometry, max [s] | time [s] |'
)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown: a line that says what was done, then the groups."""
    source = {'features': 'point features at 0.2 px', 'images': 'rendered images'}
    lines = [
        f'{document["starts"]} starts in `{document["region"]}`, the same for each camera, '
        f'{source[document["source"]]}, at most {document["longest_s"]:g} s a run; the servo is '
        f'told nothing of the mount. Seed {document["seed"]}, commit {document["commit"]}.',
        'Errors of the runs that arrived; excursion (largest distance over the first) and the '
        'time driven on bearings more than 10 deg wrong of all runs.',
    ]
    for group, title in GROUPS.items():
        rows = [row for row in document['rows'] if row['group'] == group]
        if rows:
            lines += ['', f'| {title} {HEAD}', '|---' * 8 + '|', *map(_row, rows)]
    return '\n'.join(lines)


def _row(row: Mapping[str, Any]) -> str:
    cells: Sequence[str] = (
        row['name'],
        f'{100.0 * row["success_rate"]:.0f} %',
        str(row['arrived_but_wrong']),
        _pair(row['position_error_m'], ('median', 'p95'), 1e3, 1),
        number(row['heading_error_deg']['p95'], 1.0, 2),
        _pair(row['excursion'], ('p95', 'max'), 1.0, 2),
        number(row['wrong_geometry_s']['max'], 1.0, 1),
        number(row['duration_s']['median'], 1.0, 0),
    )
    return f'| {" | ".join(cells)} |'


def _pair(spread: Mapping[str, Any], names: tuple[str, str], scale: float, digits: int) -> str:
    return ' / '.join(number(spread[name], scale, digits) for name in names)


def number(value: float | None, scale: float, digits: int) -> str:
    """Return a figure; a dash where there is none, as of runs of which no one arrived."""
    if value is None or math.isnan(value):
        return '-'
    return f'{scale * value:.{digits}f}'
