"""Draws docs/data_flow.png, the nodes and their topics: python docs/data_flow_figure.py."""

from pathlib import Path
import sys
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK

WIDTH, HEIGHT = 118.0, 62.0  # of the drawing; ten units are an inch
BOX_WIDTH, BOX_HEIGHT = 17.0, 10.0
ROW, BUS = 36.0, 17.5  # lower edge of the nodes, and the line that all topics join
WORLD, ROBOT, LOOKER = '#0072B2', '#009E73', '#8A5A00'
PAPER = 'white'
# Node: left edge, colour, what it is.
NODES = {
    'unicycle_node': (3.0, WORLD, 'the base, simulated'),
    'camera_node': (35.0, WORLD, 'the camera, simulated'),
    'tracker_node': (67.0, ROBOT, 'finds the features\nof the photograph'),
    'servo_node': (98.0, ROBOT, 'epipoles in,\nvelocities out'),
}
OUTPUTS = {
    'unicycle_node': 'odom\ncmd_vel_applied',
    'camera_node': 'joint_states',
    'tracker_node': 'overlay/image_raw\n~/settings\n~/events',
    'servo_node': 'epipoles\ngoal_pose\nphase\n/diagnostics\n~/markers',
}


def draw() -> Figure:
    """Draw the nodes in a row, the loop that they close, and who looks on."""
    figure = Figure(figsize=(WIDTH / 10.0, HEIGHT / 10.0))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, WIDTH), ylim=(0.0, HEIGHT))
    axes.axis('off')
    _area(axes, 1.0, 53.0, WORLD, "simulated world, or your robot's drivers")
    _area(axes, 65.0, 52.0, ROBOT, 'what drives the robot')
    for name, (left, colour, text) in NODES.items():
        _box(axes, left, ROW, name, text, colour)
    _loop(axes)
    _onlookers(axes)
    return figure


def _area(axes: Axes, left: float, width: float, colour: str, text: str) -> None:
    shape = FancyBboxPatch(
        (left, ROW - 5.0),
        width,
        BOX_HEIGHT + 7.0,
        boxstyle='round,pad=0,rounding_size=2',
        facecolor=colour,
        alpha=0.09,
        edgecolor='none',
    )
    axes.add_patch(shape)
    axes.text(left + 7.5, ROW - 3.3, text, color=colour, fontsize=9.5, style='italic')


def _box(
    axes: Axes, left: float, low: float, name: str, text: str, colour: str, width: float = 0.0
) -> None:
    width = width or BOX_WIDTH
    shape = FancyBboxPatch(
        (left, low),
        width,
        BOX_HEIGHT,
        boxstyle='round,pad=0,rounding_size=1.4',
        facecolor=PAPER,
        edgecolor=colour,
        linewidth=1.8,
    )
    axes.add_patch(shape)
    middle = left + 0.5 * width
    axes.text(middle, low + 7.0, name, ha='center', va='center', fontsize=11.0, weight='bold')
    axes.text(middle, low + 3.2, text, ha='center', va='center', fontsize=8.6, color='#444444')


def _arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], *, style: Any = '-'
) -> None:
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle='-|>',
            mutation_scale=14.0,
            linewidth=1.5,
            linestyle=style,
            color=INK,
            shrinkA=0.0,
            shrinkB=0.0,
        )
    )


def _topic(axes: Axes, x: float, y: float, text: str, *, ha: str = 'center') -> None:
    axes.text(x, y, text, ha=ha, va='center', fontsize=9.2, family='monospace', color=INK)


def _loop(axes: Axes) -> None:
    """Draw the topics that lead from the base round to the base."""
    lefts = [left for left, *_ in NODES.values()]
    middle = ROW + 0.5 * BOX_HEIGHT
    for (here, there), text, y in (
        ((0, 1), 'ground_truth', middle),
        ((1, 2), 'image_raw', middle + 2.3),
        ((2, 3), 'tracks', middle),
    ):
        _arrow(axes, (lefts[here] + BOX_WIDTH, y), (lefts[there], y))
        _topic(axes, 0.5 * (lefts[here] + BOX_WIDTH + lefts[there]), y + 1.6, text)
    low = middle - 2.6
    _arrow(axes, (lefts[1] + BOX_WIDTH, low), (lefts[2], low), style=(0, (4, 2)))
    gap = 0.5 * (lefts[1] + BOX_WIDTH + lefts[2])
    _topic(axes, gap, low - 1.6, 'desired/image_raw')
    _over(axes, lefts[1] + 12.0, (lefts[2] + 12.0, lefts[3] + 4.0), 53.5, 'camera_info')
    _over(axes, lefts[3] + 13.0, (lefts[0] + 8.5,), 58.5, 'cmd_vel')


def _over(axes: Axes, x: float, ends: tuple[float, ...], y: float, text: str) -> None:
    """Lead a topic over the nodes from ``x`` to its subscribers at ``ends``."""
    top = ROW + BOX_HEIGHT
    axes.plot([x, x, ends[-1]], [top, y, y], color=INK, lw=1.5, solid_joinstyle='round')
    for end in ends:
        _arrow(axes, (end, y), (end, top))
    _topic(axes, 0.5 * (x + ends[0]), y + 1.6, text)


def _onlookers(axes: Axes) -> None:
    """Draw what else is published, and who takes it."""
    axes.plot([4.0, WIDTH - 4.0], [BUS, BUS], color=LOOKER, lw=2.4, solid_capstyle='round')
    for name, text in OUTPUTS.items():
        x = NODES[name][0] + 3.0
        _arrow(axes, (x, ROW), (x, BUS + 0.4))
        _topic(axes, x + 1.5, 0.5 * (ROW - 5.0 + BUS) + 0.2, text, ha='left')
    low = 2.0
    for left, width, name, text in (
        (8.0, 20.0, 'recorder_node', 'every topic, undecoded'),
        (78.0, 24.0, 'RViz, Foxglove', 'layouts in config/'),
    ):
        _box(axes, left, low, name, text, LOOKER, width)
        _arrow(axes, (left + 0.5 * width, BUS), (left + 0.5 * width, low + BOX_HEIGHT))
    text = 'replay: to the last bit\nreport: one HTML page'
    _box(axes, 42.0, low, 'visual_servo', text, LOOKER, 22.0)
    _arrow(axes, (28.0, low + 5.0), (42.0, low + 5.0))
    _topic(axes, 35.0, low + 6.7, 'a bag')


def main(target: Path) -> None:
    """Draw into ``target``."""
    with rc_context(FIGURE_SETTINGS):
        draw().savefig(target, dpi=110, metadata={'Software': None})


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name('data_flow.png'))
