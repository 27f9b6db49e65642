"""What the paper's parts share: its numbered figures, and its statements beside our results."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.evaluation.tables import markdown
from visual_servo_epipolar.report.canvas import new_figure
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK

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


@rc_context(FIGURE_SETTINGS)
def decaying(
    number: int,
    title: str,
    name: str,
    unit: str,
    samples: tuple[FloatArray, FloatArray],
    fit: 'Decay | None' = None,
) -> Figure:
    """Draw a quantity at its times in the second step on a linear and a logarithmic axis."""
    figure, (time, values) = numbered(number, f'{title}, second step', 3.0), samples
    linear, logarithmic = figure.subplots(1, 2)
    colour = phase_colour('matching_features')
    linear.plot(time, values, color=colour, label=f'${name}$')
    logarithmic.plot(time, np.abs(values), color=colour, label=f'$|{name}|$')
    logarithmic.set_yscale('log')
    label(linear, 'time [s]', f'${name}$ [{unit}]')
    label(logarithmic, 'time [s]', f'$|{name}|$ [{unit}]')
    if fit is not None:
        fitted = time[time <= fit.end]
        for axes in (linear, logarithmic):
            axes.plot(fitted, fit.at(fitted), color=INK, ls='--', lw=0.8, label='exponential')
            axes.legend()
        logarithmic.set_title(f'fitted rate {fit.rate:.5f} s$^{{-1}}$', fontsize=9.0)
    return figure


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


@dataclass(frozen=True, slots=True)
class Statement:
    """
    One claim of the paper beside our result.

    ``place`` is where the paper makes it; ``agrees`` is None where its text gives nothing to
    compare with, and then ``paper`` says so.
    """

    place: str
    paper: str
    ours: str
    agrees: bool | None = None

    @property
    def agreement(self) -> str:
        """Whether the two agree, in a word."""
        return {True: 'yes', False: 'no', None: '-'}[self.agrees]


NO_NUMBER = 'the text gives no number'


def markdown_of(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as a table in Markdown under a heading."""
    rows = [(s.place, s.paper, s.ours, s.agreement) for s in statements]
    head = ' | the paper | ours | agrees'
    return '\n'.join([f'## {title}', '', *markdown(head, rows), ''])


def plain(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as people read them on a terminal, one result a line."""
    marks = {True: 'agrees   ', False: 'DISAGREES', None: 'no number'}
    lines = [f'  {marks[s.agrees]}  {s.place}: {s.ours}' for s in statements]
    return '\n'.join([title, *lines])


@dataclass(frozen=True, slots=True)
class Decay:
    """
    value(t) ~ initial exp(-rate t) until ``end`` [s]; rate in 1/s.

    ``misfit`` is the standard deviation of the logarithm about the line.
    """

    rate: float
    initial: float
    misfit: float
    end: float

    def at(self, time: FloatArray) -> FloatArray:
        """Return the fitted values at ``time`` [s], shape (N,)."""
        return np.asarray(self.initial * np.exp(-self.rate * time))


def decay(time: FloatArray, value: FloatArray) -> Decay:
    """
    Fit an exponential to |value|, shape (N,), at ``time`` [s] by least squares in the logarithm.

    Raises ValueError with fewer than three values that differ from zero.
    """
    good = np.isfinite(value) & (value != 0.0)
    if int(good.sum()) < 3:
        raise ValueError(
            f'a decay needs three values that are not zero, got {int(good.sum())}; '
            'fit a longer stretch'
        )
    time, logarithm = time[good], np.log(np.abs(value[good]))
    slope, offset = np.polyfit(time, logarithm, 1)
    misfit = float(np.std(logarithm - (slope * time + offset)))
    return Decay(-float(slope), math.exp(offset), misfit, float(time[-1]))
