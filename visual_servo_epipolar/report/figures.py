"""Figures of a run: its path seen from above, and its signals over time."""

from collections.abc import Callable, Sequence
from functools import partial
import math
from operator import attrgetter
from pathlib import Path
import textwrap

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, SymmetricalLogLocator
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import (
    end_s,
    phase_spans,
    PhaseSpan,
    RunLog,
    Sample,
    seconds,
)
from visual_servo_epipolar.files import whole
from visual_servo_epipolar.report.canvas import (
    draw_field_of_view,
    draw_robot,
    legend_outside,
    new_figure,
)
from visual_servo_epipolar.report.style import (
    CURRENT_COLOUR,
    DESIRED_COLOUR,
    FIELD_OF_VIEW,
    FIGURE_SETTINGS,
    GREY,
    INK,
    phase_label,
)

Panel = Callable[[Axes, RunLog], None]

MAX_EPIPOLE = 2000.0  # abscissae beyond are off any sensible axis [px]


def column(log: RunLog, name: str) -> FloatArray:
    """Return one field of all samples, or of their poses or twists, shape (N,)."""
    return np.array(list(map(attrgetter(name), log.samples)), dtype=np.float64)


def robust_limit(*signals: FloatArray) -> float:
    """Return a bound that holds nearly all finite values: epipoles run off to infinity."""
    finite = [np.abs(signal[np.isfinite(signal)]) for signal in signals]
    bounds = [np.percentile(values, 95) for values in finite if len(values)]
    return float(np.clip(1.25 * max(bounds, default=0.0), 10.0, MAX_EPIPOLE))


def phase_patches(spans: list[PhaseSpan]) -> list[Patch]:
    """Return the key of the colours, in the order in which the phases came."""
    names = dict.fromkeys(span.name for span in spans)
    return [Patch(color=phase_colour(name), label=phase_label(name)) for name in names]


def shade(axes: Axes, spans: list[PhaseSpan]) -> None:
    """Colour the background of a panel by phase."""
    for span in spans:
        colour = phase_colour(span.name)
        axes.axvspan(span.start_s, span.end_s, color=colour, alpha=0.13, linewidth=0.0)


def _draw_epipoles(axes: Axes, log: RunLog) -> None:
    times = np.array(seconds(log))
    current, desired = column(log, 'epipole_current'), column(log, 'epipole_desired')
    limit = robust_limit(current, desired)
    pairs = (
        (current, CURRENT_COLOUR, 2.4, 'current $e_{au}$'),
        (desired, DESIRED_COLOUR, 1.1, 'desired $e_{du}$'),  # both equal in step 2: seen on top
    )
    for values, colour, width, label in pairs:
        # A gap and not a stroke across the panel where an epipole passes through infinity.
        inside = np.where(np.abs(values) <= limit, values, np.nan)
        axes.plot(times, inside, color=colour, linewidth=width, label=label)
        for sign, marker in ((1.0, '^'), (-1.0, 'v')):
            beyond = times[sign * values > limit]
            edge = np.full(len(beyond), 0.95 * sign * limit)
            axes.plot(beyond, edge, marker, color=colour, markersize=2.0, label='_beyond')
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set(ylim=(-limit, limit), ylabel='epipoles\n[px]')
    axes.yaxis.set_major_locator(MaxNLocator(5))
    _lacks(axes, current, desired)
    _key_above(axes)


def _draw_velocity(axes: Axes, log: RunLog, *, name: str, unit: str) -> None:
    # A command holds until the next one.
    axes.plot(seconds(log), column(log, f'twist.{name}'), color=INK, drawstyle='steps-post')
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.margins(y=0.12)
    axes.set_ylabel(f'{name}\nvelocity [{unit}]')
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _draw_difference(axes: Axes, log: RunLog) -> None:
    values = column(log, 'feature_difference')
    # D has a sign and falls by decades; below 100 px^2 the axis is linear.
    axes.set_yscale('symlog', linthresh=100.0)
    axes.margins(y=0.1)
    axes.plot(seconds(log), values, color=INK)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_ylabel('D [px$^2$]')
    if _lacks(axes, values):
        return
    decades = SymmetricalLogLocator(base=10.0, linthresh=100.0)
    decades.set_params(numticks=6)
    axes.yaxis.set_major_locator(decades)
    axes.yaxis.set_minor_locator(NullLocator())


def _draw_count(axes: Axes, log: RunLog) -> None:
    axes.plot(seconds(log), column(log, 'features'), color=INK, drawstyle='steps-post')
    axes.set_ylabel('visible\nfeatures')
    axes.set_ylim(bottom=0.0, top=1.15 * max(1.0, column(log, 'features').max()))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _draw_by_decades(axes: Axes, log: RunLog, *, name: str, label: str) -> None:
    values = column(log, name)
    positive = np.where(values > 0.0, values, np.nan)
    axes.plot(seconds(log), positive, color=INK)
    axes.set_ylabel(label)
    if _lacks(axes, positive):
        return
    axes.set_yscale('log')
    axes.yaxis.set_major_locator(LogLocator(numticks=5))
    axes.yaxis.set_minor_locator(NullLocator())


def _lacks(axes: Axes, *signals: FloatArray) -> bool:
    """Say in the panel if there is nothing to show, and return whether that is so."""
    lacks = not any(np.isfinite(signal).any() for signal in signals)
    if lacks:
        axes.text(0.5, 0.6, 'not measured', transform=axes.transAxes, ha='center', va='bottom')
        axes.set_yticks([])
    return lacks


def _key_above(axes: Axes) -> None:
    """Put the key above the panel, where no curve runs."""
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 0.96), ncols=2, borderaxespad=0.0)


def _draw_recorded(panels: Sequence[Axes], log: RunLog, recorded: FloatArray) -> None:
    """Draw recorded commands behind those of the run, in the ``panels`` of velocities."""
    for axes, values in zip(panels, recorded.T, strict=True):
        (line,) = axes.plot(seconds(log), values, drawstyle='steps-post', label='recorded')
        line.set(color=GREY, linewidth=3.0, zorder=1)
        axes.autoscale(axis='y')
        _key_above(axes)


DRAWN: tuple[Panel, ...] = (
    _draw_epipoles,
    partial(_draw_velocity, name='linear', unit='m/s'),
    partial(_draw_velocity, name='angular', unit='rad/s'),
    _draw_difference,
    _draw_count,
    partial(_draw_by_decades, name='feature_error', label='median feature\nerror [px]'),
    partial(_draw_by_decades, name='pose.distance', label='distance [m]'),
)


ZOOM = 0.1  # half the side of the close-up around the goal [m]


@rc_context(FIGURE_SETTINGS)
def trajectory(log: RunLog) -> Figure:
    """
    Draw the path in the plane of the paper: x right, y up, in metres, and a close-up of the goal.

    The first axes hold the path, the last the close-up in millimetres.
    """
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
def signals(log: RunLog, recorded: FloatArray | None = None) -> Figure:
    """
    Draw what was measured and commanded over time, one quantity a panel, phases behind.

    A dashed line marks where the run ended, arrived or failed: the base may brake for longer.
    Of a replay there are the commands that were ``recorded`` [m/s, rad/s], shape (N, 2), nan where
    there was none.
    """
    figure = new_figure(7.2, 9.4)
    heights = (1.4, *[1.0] * (len(DRAWN) - 1))
    panels = figure.subplots(len(DRAWN), 1, sharex=True, height_ratios=heights)
    spans = phase_spans(log)
    for axes, draw in zip(panels, DRAWN, strict=True):
        draw(axes, log)
        shade(axes, spans)
        if log.samples[-1].phase.ended:
            axes.axvline(end_s(log), color=INK, linewidth=0.9, linestyle='--')
        # Left of the axes, of their width: ``align_ylabels`` takes 0.15 s for seven.
        axes.yaxis.set_label_coords(-0.075, 0.5)
    panels[0].set_xlim(0.0, max(seconds(log)[-1], 1e-3))
    if recorded is not None:
        _draw_recorded(panels[1:3], log, recorded)
    panels[-1].set_xlabel('time [s]')
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
        figure.savefig(partial, dpi=150, format=path.suffix[1:] or 'png')
    return path


def save_all(log: RunLog, folder: Path) -> list[Path]:
    """Draw both figures of a run into ``folder`` and return their paths."""
    drawings = {'signals.png': signals, 'trajectory.png': trajectory}
    return [save(draw(log), folder / name) for name, draw in drawings.items()]


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
        draw_field_of_view(axes, pose, log.field_of_view or FIELD_OF_VIEW)
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
    x, y = column(log, 'pose.x') / unit, column(log, 'pose.y') / unit
    phases = [sample.phase for sample in log.samples]
    cuts = [0, *(k for k in range(1, len(x)) if phases[k] is not phases[k - 1]), len(x)]
    for first, end in zip(cuts, cuts[1:], strict=False):
        colour, stretch = phase_colour(phases[first].value), slice(first, end + 1)
        label = phases[first].value
        axes.plot(x[stretch], y[stretch], color=colour, linewidth=2.0, label=label, zorder=3)


def _draw_key(axes: Axes, log: RunLog) -> None:
    handles = [
        *phase_patches(phase_spans(log)),
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
