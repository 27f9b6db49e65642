"""Map of a sweep: its starts and their outcomes."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, HALF_PI
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.report.canvas import (
    draw_field_of_view,
    draw_robot,
    legend_outside,
    new_figure,
)
from visual_servo_epipolar.report.style import FIELD_OF_VIEW, FIGURE_SETTINGS, INK

Run = Mapping[str, Any]
ERRORS_MM = (0.1, 50.0)  # ends of the colour scale; beyond the upper one a run is wrong
COLOURS = 'viridis_r'
FAILED_COLOUR = phase_colour('failed')
WRONG_COLOUR = '#CC79A7'
WEDGE_REACH = 1.0  # [m]
PANEL_HEIGHT, PANEL_WIDTHS = 4.6, (2.5, 6.0)  # [in]; narrower ones have no room for a title
LEAST_WIDTH = 5.0  # of the figure [in]: so wide is the key
LIMIT_M, LIMIT_DEG = 0.05, 2.0


@rc_context(FIGURE_SETTINGS)
def starts(
    documents: Mapping[str, Mapping[str, Any]], *, field_of_view: float = FIELD_OF_VIEW
) -> Figure:
    """
    Draw the starts in the plane of the paper, in metres: colour for outcome and error.

    ``documents`` are law -> document as `visual_servo sweep` writes it, one panel each, in their
    order, before the colour bar. ``field_of_view`` is the camera's horizontal angle [rad].
    """
    figure = new_figure(*_size(documents))
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


def kind(run: Run) -> str:
    """Return the outcome of a run: arrived, wrong (more than 5 cm or 2 deg), failed, raised."""
    if 'traceback' in run:
        return 'raised'
    if run['outcome'] != 'arrived':
        return 'failed'
    off = run['position_error_m'] > LIMIT_M or abs(run['heading_error_deg']) > LIMIT_DEG
    return 'wrong' if off else 'arrived'


def _size(documents: Mapping[str, Mapping[str, Any]]) -> tuple[float, float]:
    """Return width and height [in] that leave little white around panels of equal scale."""
    places = np.concatenate([_places(of['runs']) for of in documents.values()])
    low, high = places.min(axis=0), places.max(axis=0)
    wide, tall = np.maximum(high, WEDGE_REACH) - np.minimum(low, -WEDGE_REACH)
    panel = float(np.clip(PANEL_HEIGHT * wide / tall, *PANEL_WIDTHS))
    return max(1.6 + panel * len(documents), LEAST_WIDTH), PANEL_HEIGHT + 1.3


def _draw_starts(axes: Axes, runs: Sequence[Run], field_of_view: float) -> PathCollection:
    draw_field_of_view(axes, DESIRED_POSE, field_of_view, WEDGE_REACH)
    draw_robot(axes, DESIRED_POSE, dashed=True)
    size = float(np.clip(900.0 / len(runs), 5.0, 30.0))  # of a marker [pt^2]
    groups = {
        name: [run for run in runs if kind(run) == name]
        for name in ('failed', 'arrived', 'wrong', 'raised')
    }
    arrived = groups['arrived']
    errors = [1e3 * run['position_error_m'] for run in arrived]
    _draw_headings(axes, groups['failed'], FAILED_COLOUR)
    x, y = _places(arrived).T
    coloured = axes.scatter(
        x, y, s=size, c=errors, cmap=COLOURS, norm=LogNorm(*ERRORS_MM), zorder=3
    )
    _draw_headings(axes, arrived, coloured.to_rgba(np.array(errors)))
    x, y = _places(groups['failed']).T
    axes.scatter(x, y, s=size, marker='x', c=FAILED_COLOUR, lw=0.9, zorder=4)
    x, y = _places(groups['wrong']).T
    axes.scatter(x, y, s=4 * size, marker='s', c=WRONG_COLOUR, ec=INK, zorder=5)
    x, y = _places(groups['raised']).T
    axes.scatter(x, y, s=6 * size, marker='*', c=INK, zorder=6)
    return coloured


def _draw_headings(axes: Axes, runs: Sequence[Run], colour: Any) -> None:
    if not runs:
        return
    theta = HALF_PI + np.radians([run['start'][2] for run in runs])
    wide, tall = np.maximum(np.ptp(_places(runs), axis=0), 2.0 * WEDGE_REACH)
    length = 0.6 * math.sqrt(wide * tall / (len(runs) + 40.0))  # [m], shorter if they are dense
    axes.quiver(
        *_places(runs).T,
        length * np.cos(theta),
        length * np.sin(theta),
        color=colour,
        angles='xy',
        scale_units='xy',
        scale=1.0,
        units='xy',
        width=0.05 * length,
        headwidth=4.0,
        zorder=2,
    )


def _places(runs: Sequence[Run]) -> FloatArray:
    return np.array([run['start'][:2] for run in runs], dtype=np.float64).reshape(-1, 2)


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
