"""Figure of a replay: the recorded and the replayed run, one above the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.servo.run_log import PhaseSpan
from visual_servo_epipolar.report.canvas import legend_outside, new_figure
from visual_servo_epipolar.report.panels import draw_strip, phase_patches, robust_limit
from visual_servo_epipolar.report.style import CURRENT_COLOUR, FIGURE_SETTINGS, INK

RECORDED = '#9A9A9A'
PANELS: tuple[tuple[str, str], ...] = (
    ('epipole_current_px', 'current\nepipole [px]'),
    ('epipole_desired_px', 'desired\nepipole [px]'),
    ('linear_m_s', 'linear\nvelocity [m/s]'),
    ('angular_rad_s', 'angular\nvelocity [rad/s]'),
)


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Signals over time: ``times`` [s] and each of ``values`` have shape (N,); nan is a gap."""

    times: FloatArray
    phases: Sequence[str] = ()
    values: Mapping[str, FloatArray] = field(default_factory=dict)

    def spans(self) -> list[PhaseSpan]:
        """Return the phases one after the other; steps without one are left out."""
        spans: list[PhaseSpan] = []
        for time, name in zip(self.times.tolist(), self.phases, strict=True):
            if spans:
                spans[-1] = PhaseSpan(spans[-1].name, spans[-1].start_s, time)
            if not spans or spans[-1].name != name:
                spans.append(PhaseSpan(name, time, time))
        return [span for span in spans if span.name]


@rc_context(FIGURE_SETTINGS)
def comparison(
    recorded: Signals,
    replayed: Signals,
    divergence_s: float | None = None,
    end_s: float | None = None,
) -> Figure:
    """
    Draw phases, epipoles and commands of both, where they diverge and where the run ends.

    Raises ValueError if nothing was replayed.
    """
    if not len(replayed.times):
        raise ValueError('a replay must have steps to be drawn, got none; replay images or tracks')
    figure = new_figure(7.2, 7.6)
    grid = figure.add_gridspec(2 + len(PANELS), 1, height_ratios=(0.2, 0.2, *[1.0] * len(PANELS)))
    strips = [figure.add_subplot(grid[0])]
    strips.append(figure.add_subplot(grid[1], sharex=strips[0]))
    strips[0].set_xlim(0.0, max(float(replayed.times[-1]), 1e-3))
    for axes, signals, name in zip(
        strips, (recorded, replayed), ('recorded ', 'replayed '), strict=True
    ):
        draw_strip(axes, signals.spans())
        axes.text(0.0, 0.5, name, transform=axes.transAxes, ha='right', va='center', fontsize=8.0)
    for row, (name, label) in enumerate(PANELS, start=2):
        axes = figure.add_subplot(grid[row], sharex=strips[0])
        _draw(axes, recorded, replayed, name)
        _mark(axes, divergence_s, ':', 'they diverge')
        _mark(axes, end_s, '--', 'end of the run')
        axes.set_ylabel(label)
        axes.tick_params(labelbottom=row == 1 + len(PANELS))
    figure.axes[2].legend(loc='lower right', bbox_to_anchor=(1.0, 0.96), ncols=4)
    figure.axes[-1].set_xlabel('time [s]')
    figure.align_ylabels(figure.axes[2:])
    spans = [*recorded.spans(), *replayed.spans()]
    legend_outside(figure, phase_patches(spans), 'upper left', ncols=5)
    return figure


def _draw(axes: Axes, recorded: Signals, replayed: Signals, name: str) -> None:
    series = [
        (signals.times, signals.values[name], colour, width, label)
        for signals, colour, width, label in (
            (recorded, RECORDED, 3.0, 'recorded'),
            (replayed, CURRENT_COLOUR, 1.0, 'replayed'),
        )
        if name in signals.values
    ]
    for times, values, colour, width, label in series:
        axes.plot(times, values, color=colour, linewidth=width, label=label)
    if name.endswith('_px'):  # epipoles run off to infinity
        limit = robust_limit(*(values for _, values, *_ in series))
        axes.set_ylim(-limit, limit)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _mark(axes: Axes, time_s: float | None, line: str, label: str) -> None:
    if time_s is not None:
        axes.axvline(time_s, color=INK, linewidth=0.9, linestyle=line, label=label)


def columns(
    rows: Sequence[Mapping[str, float | str]], names: Sequence[str]
) -> dict[str, FloatArray]:
    """Return each of ``names`` that any of ``rows`` has, shape (N,), nan where it is missing."""
    return {
        name: np.array([row.get(name, np.nan) for row in rows], dtype=np.float64)
        for name in names
        if any(name in row for row in rows)
    }
