"""Histograms of the errors of a sweep: position and heading, on logarithmic axes."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
import math
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.report.canvas import legend_outside, new_figure
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK

# Colours of the laws in the order of their table; all are of Okabe and Ito's palette.
PALETTE = ('#D55E00', '#E69F00', '#0072B2', '#009E73', '#CC79A7', '#56B4E9')
BINS_A_DECADE = 8
QUANTITIES = (  # key, label, unit, beyond that an arrival is wrong
    ('position_error_m', 'position error [mm]', 1e3, 50.0),
    ('heading_error_deg', 'heading error [deg]', 1.0, 2.0),
)


@rc_context(FIGURE_SETTINGS)
def errors(documents: Mapping[str, Mapping[str, Any]]) -> Figure:
    """
    Draw histograms of the absolute errors of the runs that arrived, one outline a law.

    ``documents`` are law -> document as `visual_servo sweep` writes it.
    """
    figure = new_figure(7.2, 3.2)
    panels = figure.subplots(1, len(QUANTITIES), squeeze=False)[0]
    for axes, (name, label, unit, limit) in zip(panels, QUANTITIES, strict=True):
        values = {law: _values(of['runs'], name, unit) for law, of in documents.items()}
        _draw_panel(axes, values, limit)
        axes.set(xscale='log', xlabel=label)
    panels[0].set_ylabel('runs that arrived')
    legend_outside(figure, _key(documents), 'upper left', ncols=len(documents) + 2)
    return figure


def edges(values: FloatArray, limit: float) -> FloatArray:
    """Return edges of bins over whole decades that hold ``values`` and ``limit``."""
    positive = np.append(values[values > 0.0], limit)
    low, high = math.floor(math.log10(positive.min())), math.ceil(math.log10(positive.max()))
    return np.asarray(np.logspace(low, high, (high - low) * BINS_A_DECADE + 1), dtype=np.float64)


def _draw_panel(axes: Axes, values: Mapping[str, FloatArray], limit: float) -> None:
    bins = edges(np.concatenate(list(values.values())), limit)
    colours = law_colours(values)
    for law, errors_of_law in values.items():
        if not len(errors_of_law):
            continue
        colour = colours[law]
        # An error of nothing belongs into the first bin: there is no zero on this axis.
        axes.hist(
            np.clip(errors_of_law, bins[0], None),
            bins=bins.tolist(),
            histtype='stepfilled',
            facecolor=f'{colour}30',
            edgecolor=colour,
            linewidth=1.3,
        )
        axes.axvline(float(np.quantile(errors_of_law, 0.95)), color=colour, ls='--', lw=1.0)
    axes.axvline(limit, color=INK, ls=':', lw=1.0)
    axes.set_xlim(bins[0], bins[-1])
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis='x', which='minor', visible=False)


def _values(runs: Sequence[Mapping[str, Any]], name: str, unit: float) -> FloatArray:
    errors_of_arrived = [abs(run[name]) for run in runs if run['outcome'] == 'arrived']
    return unit * np.array(errors_of_arrived, dtype=np.float64)


def _key(documents: Mapping[str, Mapping[str, Any]]) -> list[Patch | Line2D]:
    colours = law_colours(documents)
    laws = [
        Patch(
            facecolor=f'{colours[law]}30',
            edgecolor=colours[law],
            label=f'law {law}, {document["arrived"]} runs',
        )
        for law, document in documents.items()
    ]
    lines = (('--', 'p95'), (':', 'wrong beyond'))
    return laws + [Line2D([], [], color=INK, lw=1.0, ls=ls, label=label) for ls, label in lines]


def law_colours(laws: Iterable[str]) -> dict[str, str]:
    """Return a colour for each law: those of the table keep theirs, expressions take the rest."""
    own = dict(zip(LAWS, PALETTE, strict=False))
    spare = cycle(PALETTE[len(own) :] or PALETTE)
    return {law: own[law] if law in own else next(spare) for law in laws}
