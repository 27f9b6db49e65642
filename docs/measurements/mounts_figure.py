"""
Draws mounts.png and prints the tables of docs/results.md.

`python mounts_figure.py [RESULT.json] [TARGET.png]`: of what `visual_servo bench mounts
--json RESULT.json` wrote, or of a run of its own, which takes an hour on one core.
"""

from collections.abc import Callable, Mapping, Sequence
import json
from pathlib import Path
import sys
from typing import Any

from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from visual_servo_epipolar.evaluation.benchmarks import mounts
from visual_servo_epipolar.evaluation.benchmarks.mounts import (
    AHEADS,
    ASIDES,
    ROLLS,
    TILTS,
    YAWS,
)
from visual_servo_epipolar.evaluation.tables import number
from visual_servo_epipolar.report.canvas import legend_outside
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, text_colour_on

COLOURS, SHARE = colormaps['cividis'], Normalize(0.0, 100.0)
ALARM = '#D55E00'
MOST_EXCURSION, MOST_WRONG_S = 1.2, 1.0

Row = Mapping[str, Any]
Columns = Sequence[float]


def draw(document: Mapping[str, Any]) -> Figure:
    """Draw arrivals and errors over tilt and roll, and over yaw and the place of the camera."""
    figure = Figure(figsize=(7.2, 5.4), layout='constrained')
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, gridspec_kw={'height_ratios': (1.0, 2.4)})
    rows = {group: [it for it in document['rows'] if it['group'] == group] for group in GROUPS}
    _panel(upper, TILTS, ROLLS, _by(rows['attitude'], lambda it: (it['tilt'], it['roll'])))
    upper.set(xlabel='tilt, down positive [deg]', ylabel='roll [deg]')
    upper.set_yticks(range(len(ROLLS)), [f'{roll:g}' for roll in ROLLS])
    places = [(ahead, aside) for ahead in AHEADS for aside in ASIDES]
    _panel(
        lower, YAWS, places, _by(rows['yaw'], lambda it: (it['yaw'], (it['ahead'], it['aside'])))
    )
    lower.set(xlabel='yaw, left positive [deg]', ylabel='ahead, aside of the axle [m]')
    lower.set_yticks(range(len(places)), [f'{ahead:g}, {aside:g}' for ahead, aside in places])
    colours = ScalarMappable(SHARE, COLOURS)
    figure.colorbar(colours, ax=[upper, lower], label='arrived [%]', aspect=40.0)
    alarm = Rectangle((0.0, 0.0), 1.0, 1.0, fill=False, edgecolor=ALARM, lw=2.0)
    alarm.set_label('a run went beyond 1.2 d / d_0, or drove 1 s on a wrong geometry')
    legend_outside(figure, [alarm], 'upper center', ncols=1)
    return figure


GROUPS = ('attitude', 'yaw')


def _by(rows: Sequence[Row], key: Callable[[Row], Any]) -> dict[Any, Row]:
    return {key(row['mount']): row for row in rows}


def _panel(axes: Axes, columns: Columns, lines: Sequence[Any], rows: Mapping[Any, Row]) -> None:
    """Draw a cell for each column and line that was driven: arrivals, p95 of the error."""
    for x, column in enumerate(columns):
        for y, line in enumerate(lines):
            if (column, line) in rows:
                _cell(axes, x, y, rows[column, line])
    axes.set_xticks(range(len(columns)), [f'{column:g}' for column in columns])
    axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(-0.5, len(lines) - 0.5))
    axes.grid(visible=False)


def _cell(axes: Axes, x: int, y: int, row: Row) -> None:
    share = 100.0 * row['success_rate']
    colour = to_hex(COLOURS(SHARE(share)))
    axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, facecolor=colour, edgecolor='white'))
    if alarming(row):
        axes.add_patch(
            Rectangle(
                (x - 0.47, y - 0.45), 0.94, 0.9, fill=False, edgecolor=ALARM, lw=2.0, zorder=3
            )
        )
    p95 = number(row['position_error_m']['p95'], 1, 1e3)
    text = f'{share:.0f} %' + ('' if p95 == '-' else f'\n{p95} mm')
    axes.text(
        x, y, text, ha='center', va='center', fontsize=7.0, color=text_colour_on(colour), zorder=4
    )


def alarming(row: Row) -> bool:
    """Whether a run went too far away, or drove too long on a wrong geometry."""
    far = row['excursion']['max'] > MOST_EXCURSION
    return bool(far or row['wrong_geometry_s']['max'] >= MOST_WRONG_S)


def main(arguments: Sequence[str]) -> None:
    """Draw the result in the JSON file that is named, or of a new run, and print its tables."""
    given = [Path(name) for name in arguments]
    source = next((path for path in given if path.suffix == '.json'), None)
    target = next((path for path in given if path.suffix == '.png'), None)
    if source is not None:
        document = json.loads(source.read_text(encoding='utf-8'))['mounts']
    else:
        document = mounts.run(seed=0, quick=False, say=lambda text: print(text, file=sys.stderr))
    with rc_context(FIGURE_SETTINGS):
        path = target or Path(__file__).with_name('mounts.png')
        draw(document).savefig(path, dpi=130, metadata={'Software': None})
    print(mounts.table(document))


if __name__ == '__main__':
    main(sys.argv[1:])
