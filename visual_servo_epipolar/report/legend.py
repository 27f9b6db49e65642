"""Legends beside the axes of a figure, in a strip of their own."""

from collections.abc import Sequence
from typing import Any, Literal

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend

Place = Literal['upper left', 'upper center', 'lower center']
PAD_PX = 6.0  # between the legend and the axes


def legend_outside(figure: Figure, handles: Sequence[Any], place: Place, *, ncols: int) -> Legend:
    """
    Draw a legend at an edge of ``figure``, whose axes make room for it; return it.

    matplotlib itself has ``loc='outside ...'`` for this since 3.7; Ubuntu 24.04 has 3.6.

    Parameters
    ----------
    figure : Figure
        With constrained layout.
    handles : sequence of artists
        What the legend explains; their labels are its texts.
    place : str
        Where to put it, as in ``loc`` of matplotlib.
    ncols : int
        Columns of the legend.

    """
    legend: Legend = figure.legend(handles=list(handles), loc=place, ncols=ncols)
    canvas: Any = FigureCanvasAgg(figure)
    size = legend.get_window_extent(canvas.get_renderer())
    share = min((size.height + 2.0 * PAD_PX) / figure.bbox.height, 0.5)
    bottom = share if place.startswith('lower') else 0.0
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, bottom, 1.0, 1.0 - share))
    return legend
