"""Figures as the paper numbers them: their size, their titles, and the data behind them."""

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.report.canvas import new_figure

WIDTH = 7.2  # of a page between its margins [inches]


def numbered(number: int, title: str, height: float, *, width: float = WIDTH) -> Figure:
    """Return an empty figure of ``width`` x ``height`` inches under its number in the paper."""
    figure = new_figure(width, height)
    figure.suptitle(f'Fig. {number} \N{EN DASH} {title}', fontsize=10.0, x=0.02, ha='left')
    return figure


def label(axes: Axes, x: str, y: str, title: str = '') -> None:
    """Name both axes, with their units."""
    axes.set(xlabel=x, ylabel=y)
    if title:
        axes.set_title(title, fontsize=9.0)


def figure_data(figure: Figure) -> dict[str, Any]:
    """
    Return what a figure shows: the points of each labelled line, by panel and label.

    Each is an array, shape (N, 2), in the units of the axes.
    """
    return {
        f'{number}: {line.get_label()}': np.asarray(line.get_xydata(), dtype=np.float64)
        for number, axes in enumerate(figure.axes)
        for line in axes.get_lines()
        if not str(line.get_label()).startswith('_')
    }


def thin(data: Mapping[str, Any], points: int) -> dict[str, list[list[float]]]:
    """Return at most ``points`` of each line, evenly chosen with both ends, as JSON has them."""
    thin = {}
    for name, line in data.items():
        rows = np.unique(np.linspace(0, len(line) - 1, min(points, len(line))).round().astype(int))
        thin[name] = [[float(f'{value:.8g}') for value in row] for row in line[rows]]
    return thin
