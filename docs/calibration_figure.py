"""Draws docs/calibration.png, prints the table of docs/calibration.md; make calibration-figure."""

from collections.abc import Mapping
from pathlib import Path
import sys
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.evaluation.benchmarks import calibration
from visual_servo_epipolar.report.canvas import legend_outside
from visual_servo_epipolar.report.style import FIGURE_SETTINGS

COLOURS = {'front': '#0072B2', 'beside': '#D55E00'}
WIDTH = 0.05  # by which the runs of one ratio are spread, of its logarithm


def draw(document: Mapping[str, Any]) -> Figure:
    """Draw the position error of every run against f_hat / f, for both places of the camera."""
    figure = Figure(figsize=(7.2, 3.4), layout='constrained')
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, mount in zip((left, right), calibration.MOUNTS, strict=True):
        rows = [it for it in document['rows'] if it['method'] == 'found out']
        _panel(axes, [it for it in rows if it['mount'] == mount])
        axes.set_title(f'camera {mount}', fontsize=9.0)
    left.set_ylabel('distance from the goal at the end [mm]')
    handles, _ = left.get_legend_handles_labels()
    legend_outside(figure, handles, 'upper center', ncols=4)
    return figure


def _panel(axes: Axes, rows: list[Mapping[str, Any]]) -> None:
    rng = np.random.default_rng(0)
    for place, (region, colour) in enumerate(COLOURS.items()):
        for row in (it for it in rows if it['region'] == region):
            runs = [it for it in row['runs'] if it['outcome'] == 'arrived']
            errors = np.array([1e3 * it['position_error_m'] for it in runs])
            middle = np.log(row['ratio']) + (2 * place - 1) * WIDTH
            at = np.exp(middle + WIDTH * rng.uniform(-0.8, 0.8, len(errors)))
            label = f'{region}: each run' if row['ratio'] == 1.0 else None
            axes.scatter(at, errors, s=4.0, color=colour, alpha=0.45, lw=0.0, label=label)
        of = [it for it in rows if it['region'] == region]
        axes.plot(
            [it['ratio'] for it in of],
            [1e3 * it['position_error_m']['median'] for it in of],
            color=colour,
            label=f'{region}: median',
        )
    axes.axhline(10.0, color='0.4', lw=0.8, ls=':')
    axes.text(1.0, 10.2, '1 cm', fontsize=7.5, color='0.3')
    axes.set_xscale('log')
    axes.set_xticks(calibration.RATIOS, [f'{ratio:g}' for ratio in calibration.RATIOS])
    axes.set_xticks([], minor=True)
    axes.set(xlabel=r'focal length given over the true one, $\hat f / f$', ylim=(0.0, 11.0))


def main(target: Path) -> None:
    """Run the benchmark, draw it into ``target`` and print its table."""
    document = calibration.run(seed=0, quick=False, say=lambda text: print(text, file=sys.stderr))
    with rc_context(FIGURE_SETTINGS):
        draw(document).savefig(target, dpi=130, metadata={'Software': None})
    print(calibration.table(document))
    for row in document['rows']:
        if row['method'] == 'found out' and row['failure_reasons']:
            print(row['mount'], row['region'], row['ratio'], *row['failure_reasons'], sep=', ')


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name('calibration.png'))
