"""A sweep as a map of its starts and their outcomes, and as a table by law."""

from collections.abc import Callable, Mapping, Sequence
import math
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import kind
from visual_servo_epipolar.report.canvas import (
    draw_field_of_view,
    draw_robot,
    legend_outside,
    new_figure,
)
from visual_servo_epipolar.report.style import FIELD_OF_VIEW, FIGURE_SETTINGS, INK

Run = Mapping[str, Any]
ERRORS_MM = (0.1, 50.0)  # ends of the colour scale; beyond the upper one a run is wrong
FAILED_COLOUR = phase_colour('failed')
WRONG_COLOUR = '#CC79A7'


@rc_context(FIGURE_SETTINGS)
def starts(
    documents: Mapping[str, Mapping[str, Any]], *, field_of_view: float = FIELD_OF_VIEW
) -> Figure:
    """
    Draw the starts in the plane of the paper, in metres: colour for outcome and error.

    ``documents`` are law -> document as `visual_servo sweep` writes it, one panel each, in their
    order, before the colour bar. ``field_of_view`` is the camera's horizontal angle [rad].
    """
    side = 4.6  # of a map [in]
    figure = new_figure(1.6 + side * len(documents), 1.3 + side)
    panels = figure.subplots(1, len(documents), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (law, document) in zip(panels, documents.items(), strict=True):
        coloured = _draw_starts(axes, document['runs'], field_of_view)
        axes.set_title(_title(law, document), loc='left')
        axes.set(xlabel='x [m]', aspect='equal')
    panels[0].set_ylabel('y [m]')
    bar = figure.colorbar(coloured, ax=list(panels), extend='min', shrink=0.8)
    bar.set_label('position error of the runs that arrived [mm]')
    legend_outside(figure, _key_of_starts(), 'lower center', ncols=2)
    return figure


def _draw_starts(axes: Axes, runs: Sequence[Run], field_of_view: float) -> PathCollection:
    draw_field_of_view(axes, DESIRED_POSE, field_of_view)
    draw_robot(axes, DESIRED_POSE, dashed=True)
    size = float(np.clip(900.0 / len(runs), 5.0, 30.0))  # of a marker [pt^2]
    errors = [1e3 * run['position_error_m'] for run in runs if kind(run) == 'arrived']
    scale = LogNorm(*ERRORS_MM)
    looks: dict[str, dict[str, Any]] = {
        'failed': {'s': size, 'marker': 'x', 'c': FAILED_COLOUR, 'lw': 0.9, 'zorder': 4},
        'wrong': {'s': 4 * size, 'marker': 's', 'c': WRONG_COLOUR, 'ec': INK, 'zorder': 5},
        'raised': {'s': 6 * size, 'marker': '*', 'c': INK, 'zorder': 6},
        'arrived': {'s': size, 'c': errors, 'cmap': 'viridis_r', 'norm': scale, 'zorder': 3},
    }
    for name, look in looks.items():
        places = [run['start'][:2] for run in runs if kind(run) == name]
        drawn = axes.scatter(*np.array(places, np.float64).reshape(-1, 2).T, **look)
    return drawn  # of those that arrived


def _title(law: str, document: Mapping[str, Any]) -> str:
    runs, errors = document['runs'], document['position_error_m']
    words = f'law {law}: {document["arrived"]} of {len(runs)} arrived'
    if document['arrived']:
        words += f'\nmedian {1e3 * errors["median"]:.3g} mm, p95 {1e3 * errors["p95"]:.3g} mm'
    return words


def _key_of_starts() -> list[Line2D]:
    words = (
        ('o', FIGURE_SETTINGS['grid.color'], 'arrived, by its error'),
        ('x', FAILED_COLOUR, 'failed, with a reason'),
        ('s', WRONG_COLOUR, 'arrived but wrong: over 50 mm or 2 deg'),
        ('*', INK, 'raised: a defect'),
    )
    return [
        Line2D([], [], ls='', marker=marker, color=colour, label=label)
        for marker, colour, label in words
    ]


Document = Mapping[str, Any]
Documents = Mapping[str, Document]  # law -> what `visual_servo sweep` writes as JSON for it

NOTE = (
    'Errors over the runs that arrived, against ground truth, without their signs; the interval '
    "is Wilson's. Wrong: more than 50 mm or 2 deg off; wrong geometry: time driven on bearings "
    'more than 10 deg off.'
)


def table(documents: Documents) -> str:
    """Return a Markdown table of the sweep, one column a law, and one of why runs failed."""
    rows = [[name, *map(cell, documents.values())] for name, cell in _rows().items()]
    blocks = [
        f'`{next(iter(documents.values()))["sweep"]["command"]}`',
        '',
        *_markdown(['', *documents], rows),
    ]
    failures = _failures(documents)
    if failures:
        blocks += ['', *_markdown(['why runs failed', *documents], failures)]
    return '\n'.join([*blocks, '', NOTE])


def _rows() -> Mapping[str, Callable[[Document], str]]:
    return {
        'arrived': _arrivals,
        'arrived, 95 % interval [%]': lambda d: '{:.2f} to {:.2f}'.format(
            *(100.0 * value for value in d['success_interval'])
        ),
        'arrived but wrong': lambda d: str(d['arrived_but_wrong']),
        'raised': lambda d: str(d['defects']),
        'position error, median / p95 / max [mm]': lambda d: _spread(d, 'position_error_m', 1e3),
        'lateral [mm]': lambda d: _spread(d, 'lateral_error_m', 1e3),
        'longitudinal [mm]': lambda d: _spread(d, 'longitudinal_error_m', 1e3),
        'heading error [deg]': lambda d: _spread(d, 'heading_error_deg', 1.0),
        'largest distance / start distance': lambda d: _spread(d, 'max_distance_ratio', 1.0),
        'the same, all runs': lambda d: _spread(d, 'excursion', 1.0),
        'wrong geometry, all runs [s]': lambda d: _spread(d, 'wrong_geometry_s', 1.0),
        'duration [s]': lambda d: _spread(d, 'duration_s', 1.0),
        'duration / least time T_0': lambda d: _spread(d, 'time_ratio', 1.0),
        'standstills on the way': lambda d: _spread(d, 'standstills', 1.0),
        'within 20 mm without an end, all runs [s]': lambda d: _spread(d, 'standing_s', 1.0),
        'reversals of v, all runs': lambda d: _spread(d, 'reversals_v', 1.0),
        'reversals of w, all runs': lambda d: _spread(d, 'reversals_w', 1.0),
        'changes of phase': lambda d: _spread(d, 'phase_changes', 1.0),
        'peak jerk [m/s^3]': lambda d: _spread(d, 'peak_jerk_m_s3', 1.0),
        'peak jerk [rad/s^3]': lambda d: _spread(d, 'peak_jerk_rad_s3', 1.0),
        'path [m]': lambda d: _spread(d, 'path_length_m', 1.0),
        'attempts': lambda d: _spread(d, 'attempts', 1.0),
        'wall time of the sweep [s]': lambda d: _number(d['wall_s'], 1.0),
    }


def _failures(documents: Documents) -> list[list[str]]:
    """Return reason and counts, those of the last law first."""
    counts = [document['failure_reasons'] for document in documents.values()]
    reasons = sorted(
        {reason for of in counts for reason in of},
        key=lambda reason: [-of.get(reason, 0) for of in counts[::-1]],
    )
    return [[_cell(reason), *(str(of.get(reason, 0)) for of in counts)] for reason in reasons]


def _arrivals(document: Document) -> str:
    runs = len(document['runs'])
    return f'{100.0 * document["success_rate"]:.4g} % ({document["arrived"]} of {runs})'


def _spread(document: Document, name: str, unit: float) -> str:
    spread = document.get(name, {})  # that of an earlier version may lack it
    return ' / '.join(_number(spread.get(key), unit) for key in ('median', 'p95', 'max'))


def _number(value: float | None, unit: float) -> str:
    """Say a number in three digits; a dash for one that there is not."""
    if value is None or not math.isfinite(value):
        return '-'
    return f'{unit * value:.0f}' if abs(unit * value) >= 100.0 else f'{unit * value:#.3g}'


def _cell(text: str) -> str:
    return ' '.join(text.split()).replace('|', '\\|')


def _markdown(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return the lines of a table, columns padded so that it can be read as text too."""
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(len(head))]

    def line(cells: list[str]) -> str:
        padded = [cell.ljust(width) for cell, width in zip(cells, widths, strict=True)]
        return f'| {" | ".join(padded)} |'

    return [line(head), f'|{"|".join("-" * (width + 2) for width in widths)}|', *map(line, rows)]
