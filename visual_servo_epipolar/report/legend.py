"""Legends beside the axes of a figure, in a strip of their own."""

from collections.abc import Sequence
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend

PAD_PX = 6.0  # between the legend and the axes


def legend_outside(figure: Figure, handles: Sequence[Any], place: str, *, ncols: int) -> Legend:
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
        Where to put it, as in ``loc``: begins with 'upper' or 'lower'.
    ncols : int
        Columns of the legend.

    """
    legend = figure.legend(handles=list(handles), loc=place, ncols=ncols)
    size = legend.get_window_extent(FigureCanvasAgg(figure).get_renderer())
    share = min((size.height + 2.0 * PAD_PX) / figure.bbox.height, 0.5)
    bottom = share if place.startswith('lower') else 0.0
    figure.get_layout_engine().set(rect=(0.0, bottom, 1.0, 1.0 - share))
    return legend
