"""Figures of a run, for paper and screen: its path seen from above, its signals over time."""

import math
from pathlib import Path
import textwrap

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle
import numpy as np

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import (
    end_s,
    least_time_of,
    phase_spans,
    RunLog,
    Sample,
    seconds,
)
from visual_servo_epipolar.files import whole
from visual_servo_epipolar.report.canvas import (
    draw_field_of_view,
    draw_robot,
    GREY,
    legend_outside,
    new_figure,
)
from visual_servo_epipolar.report.panels import draw_strip, PANELS, phase_patches, shade
from visual_servo_epipolar.report.style import (
    CURRENT_COLOUR,
    FIELD_OF_VIEW,
    FIGURE_SETTINGS,
    INK,
    phase_label,
)

DOTS_PER_INCH = 150
ZOOM = 0.1  # half the side of the close-up around the goal [m]
WEDGE_REACH = 0.9  # [m]
LABELS_AT = -0.075  # left of the axes, of their width


@rc_context(FIGURE_SETTINGS)
def trajectory(log: RunLog) -> Figure:
    """
    Draw the path in the plane of the paper: x right, y up, in metres, and a close-up of the goal.

    The first axes hold the path, the last the close-up in millimetres. Raises ValueError if the
    run has no samples.
    """
    _check(log)
    figure = new_figure(7.2, 5.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1.0), height_ratios=(1.0, 1.1))
    plane, key = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    close = figure.add_subplot(grid[1, 1])
    _draw_plane(plane, log)
    _draw_key(key, log)
    _draw_close_up(close, log)
    figure.suptitle(_verdict(log), fontsize=10.0, x=0.02, ha='left')
    return figure


@rc_context(FIGURE_SETTINGS)
def signals(log: RunLog) -> Figure:
    """
    Draw what was measured and commanded over time, one quantity a panel, phases behind.

    A dashed line marks where the run ended, arrived or failed: the base may brake for longer. A
    dotted one marks T_0, the least time that the limits of the base allow.

    Raises ValueError if the run has no samples.
    """
    _check(log)
    figure = new_figure(7.2, 9.6)
    heights = (0.2, 1.4, *[1.0] * (len(PANELS) - 1))
    grid = figure.add_gridspec(1 + len(PANELS), 1, height_ratios=heights)
    spans, strip = phase_spans(log), figure.add_subplot(grid[0])
    strip.set_xlim(0.0, max(seconds(log)[-1], 1e-3))
    draw_strip(strip, spans)
    least = least_time_of(log)
    if least is not None and least <= strip.get_xlim()[1]:
        strip.text(least, 1.05, '$T_0$', fontsize=8.0, ha='center', va='bottom')
    for row, draw in enumerate(PANELS, start=1):
        axes = figure.add_subplot(grid[row], sharex=strip)
        draw(axes, log)
        shade(axes, spans)
        if log.samples[-1].phase.ended:
            axes.axvline(end_s(log), color=INK, linewidth=0.9, linestyle='--')
        if least is not None:
            axes.axvline(least, color=INK, linewidth=0.9, linestyle=':')
        axes.tick_params(labelbottom=row == len(PANELS))
        axes.yaxis.set_label_coords(LABELS_AT, 0.5)  # ``align_ylabels`` takes 0.15 s for seven
    figure.axes[-1].set_xlabel('time [s]')
    legend_outside(figure, phase_patches(spans), 'upper left', ncols=5)
    return figure


@rc_context(FIGURE_SETTINGS)
def save(figure: Figure, path: Path | str) -> Path:
    """
    Write ``figure`` to ``path`` and return it; the suffix chooses the format (.png, .pdf, .svg).

    The file appears whole, by rename, or not at all.
    """
    path = Path(path)
    with whole(path) as partial:
        figure.savefig(partial, dpi=DOTS_PER_INCH, format=path.suffix[1:] or 'png')
    return path


def save_all(log: RunLog, folder: Path) -> list[Path]:
    """
    Draw both figures of a run into ``folder`` and return their paths.

    Raises ValueError if the run has no samples.
    """
    drawings = {'signals.png': signals, 'trajectory.png': trajectory}
    return [save(draw(log), folder / name) for name, draw in drawings.items()]


def _check(log: RunLog) -> None:
    if not log.samples:
        raise ValueError('a run must have samples to be drawn, got none; record it first')


def _verdict(log: RunLog) -> str:
    (x, y, heading), final = log.start, log.samples[-1].pose
    title = (
        f'start x {x:.4g} m, y {y:.4g} m, heading {heading:+.4g} deg \N{EM DASH} {log.outcome}: '
        f'{1000.0 * final.distance:.1f} mm, {math.degrees(final.heading_error):+.2f} deg from the '
        'goal'
    )
    reason = '' if log.outcome == 'arrived' else log.reason  # how is no more than a word
    return '\n'.join([title, *textwrap.wrap(reason, 100)])


def _milestones(log: RunLog) -> list[Sample]:
    """Return the first sample of each phase and the last, but not twice the same pose."""
    samples = log.samples
    changes = [b for a, b in zip(samples, samples[1:], strict=False) if a.phase is not b.phase]
    milestones = [samples[0]]
    for sample in (*changes, samples[-1]):
        last = milestones[-1].pose
        moved = math.hypot(sample.pose.x - last.x, sample.pose.y - last.y)
        if moved > 0.02 or abs(sample.pose.theta - last.theta) > 0.05:
            milestones.append(sample)
    return milestones


def _draw_plane(axes: Axes, log: RunLog) -> None:
    draw_robot(axes, DESIRED_POSE, dashed=True)
    for pose in (DESIRED_POSE, log.samples[0].pose):
        draw_field_of_view(axes, pose, log.field_of_view or FIELD_OF_VIEW, WEDGE_REACH)
    _draw_path(axes, log, 1.0)
    for sample in _milestones(log):
        draw_robot(axes, sample.pose, phase_colour(sample.phase.value))
    side = 2.0 * ZOOM
    axes.add_patch(Rectangle((-ZOOM, -ZOOM), side, side, fill=False, ec=INK, lw=0.7, zorder=5))
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.set_aspect('equal', adjustable='datalim')
    axes.margins(0.05)


def _draw_path(axes: Axes, log: RunLog, unit: float) -> None:
    """Draw one line a stretch of a phase; each ends where the next begins."""
    x = np.array([sample.pose.x for sample in log.samples]) / unit
    y = np.array([sample.pose.y for sample in log.samples]) / unit
    phases = [sample.phase for sample in log.samples]
    cuts = [0, *(k for k in range(1, len(x)) if phases[k] is not phases[k - 1]), len(x)]
    for first, end in zip(cuts, cuts[1:], strict=False):
        colour, stretch = phase_colour(phases[first].value), slice(first, end + 1)
        label = phases[first].value
        axes.plot(x[stretch], y[stretch], color=colour, linewidth=2.0, label=label, zorder=3)


def _draw_key(axes: Axes, log: RunLog) -> None:
    names = dict.fromkeys(sample.phase.value for sample in log.samples)
    handles = [
        *(Line2D([], [], color=phase_colour(n), lw=2.0, label=phase_label(n)) for n in names),
        Patch(facecolor='none', edgecolor=INK, label='robot at a change of phase'),
        Patch(facecolor='none', edgecolor=GREY, linestyle='--', label='goal'),
        Patch(facecolor=GREY, alpha=0.25, label='field of view'),
        Line2D([], [], ls='', marker='s', mfc='none', mec=INK, mew=0.7, label='close-up below'),
    ]
    axes.set_axis_off()
    axes.legend(handles=handles, loc='upper left', borderaxespad=0.0)


def _draw_close_up(axes: Axes, log: RunLog) -> None:
    """Draw the last centimetres around the goal, in millimetres."""
    side, final = 1000.0 * ZOOM, log.samples[-1].pose
    for radius in (10.0, 50.0):
        axes.add_patch(Circle((0.0, 0.0), radius, fill=False, ec='#AAAAAA', lw=0.7, ls=':'))
    axes.plot(0.0, 0.0, '+', color=INK, markersize=12.0, zorder=2)
    _draw_path(axes, log, 0.001)
    x, y = 1000.0 * final.x, 1000.0 * final.y
    colour = phase_colour(log.samples[-1].phase.value)
    axes.plot(x, y, 'o', color=colour, markersize=4.5, markeredgecolor='white', zorder=5)
    if max(abs(x), abs(y)) > side:
        axes.set_title('end of the path is outside', fontsize=8.0, color=CURRENT_COLOUR)
    else:
        axes.set_title('around the goal; rings of 10 and 50 mm', fontsize=8.0)
    axes.set(xticks=(-side, -0.5 * side, 0.0, 0.5 * side, side))
    axes.set(xlim=(-side, side), ylim=(-side, side), xlabel='x [mm]', ylabel='y [mm]')
    axes.set_aspect('equal')
