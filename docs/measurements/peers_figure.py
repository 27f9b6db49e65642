"""Draws peers.png and prints the table of docs/results.md: python peers_figure.py."""

from collections.abc import Mapping
import math
from pathlib import Path
import sys
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.benchmarks import laws
from visual_servo_epipolar.evaluation.benchmarks.laws import LAWS
from visual_servo_epipolar.report.canvas import legend_outside
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK, robot_body, robot_nose

FATES = {
    'reached': ('#009E73', 'o', 'reached'),
    'missed': ('#E69F00', 's', 'elsewhere'),
    'lost': ('#D55E00', 'x', 'features lost'),
}
COLOURS = dict(zip(LAWS, ('#0072B2', '#117733', '#009E73', '#E69F00', '#D55E00'), strict=True))
STYLES = dict(zip(LAWS, ('-', '-', '--', '-.', ':'), strict=True))


def draw(document: Mapping[str, Any]) -> Figure:
    """Draw where each law arrives from, and how far from the goal, and when, its runs end."""
    figure = Figure(figsize=(8.6, 6.0), layout='constrained')
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2 * len(LAWS), height_ratios=(1.3, 1.0))
    runs = document['runs']
    for column, law in enumerate(LAWS):
        axes = figure.add_subplot(grid[0, 2 * column : 2 * column + 2])
        _map(axes, [it for it in runs if it['law'] == law], law)
    figure.axes[0].set_ylabel('y [m]')
    handles, _ = figure.axes[0].get_legend_handles_labels()
    legend_outside(figure, handles, 'upper center', ncols=3)
    for place, name, scale, label in (
        (grid[1, : len(LAWS)], 'position_error_m', 1e3, 'distance from the goal at the end [mm]'),
        (grid[1, len(LAWS) :], 'duration_s', 1.0, 'duration of the runs that reached it [s]'),
    ):
        axes = figure.add_subplot(place)
        for law in LAWS:
            of = [it for it in runs if it['law'] == law]
            values = [scale * it[name] for it in of if scale > 1.0 or it['fate'] == 'reached']
            axes.step(
                [*sorted(values), math.inf][:-1] or [math.nan],
                100.0 * np.arange(1, max(len(values), 1) + 1) / len(of),
                where='post',
                color=COLOURS[law],
                ls=STYLES[law],
                label=law,
            )
        if scale > 1.0:
            axes.set_xscale('log')
        axes.set(xlabel=label, ylabel='runs up to there [%]', ylim=(0.0, 103.0))
    figure.axes[-1].set_xlim(right=46.0)  # room for the legend
    figure.axes[-1].legend(loc='lower right')
    return figure


def _map(axes: Axes, runs: list[Mapping[str, Any]], law: str) -> None:
    for fate, (colour, marker, label) in FATES.items():
        places = np.array([it['start'][:2] for it in runs if it['fate'] == fate]).reshape(-1, 2)
        axes.scatter(
            places[:, 0], places[:, 1], c=colour, marker=marker, s=14.0, label=label, lw=1.0
        )
    axes.fill(*robot_body(DESIRED_POSE).T, facecolor='none', edgecolor=INK)
    axes.fill(*robot_nose(DESIRED_POSE).T, facecolor=INK)
    axes.set(xlabel='x [m]', xlim=(-1.8, 1.8), ylim=(-5.3, 1.9))
    axes.set_aspect('equal')
    axes.set_title(law, fontsize=9.0)


def main(target: Path) -> None:
    """Run the benchmark, draw it into ``target`` and print its table."""
    document = laws.run(seed=0, quick=False, say=lambda _: None)
    with rc_context(FIGURE_SETTINGS):
        draw(document).savefig(target, dpi=130, metadata={'Software': None})
    print(laws.table(document))


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name('peers.png'))
