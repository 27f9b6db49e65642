"""Panels of the figure of signals: one quantity each, over time."""

from collections.abc import Callable
from functools import partial

from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import PhaseSpan, RunLog, seconds
from visual_servo_epipolar.report.style import (
    CURRENT_COLOUR,
    DESIRED_COLOUR,
    INK,
    phase_label,
    text_colour_on,
)

Panel = Callable[[Axes, RunLog], None]

MOST_STRIDES = 4.5  # from tick to tick on the axis of D
STANDING, STANDING_AXIS = 0.02, 0.1  # range of velocities of a robot that stands [m/s, rad/s]
MAX_EPIPOLE = 2000.0  # abscissae beyond are off any sensible axis [px]
CHARACTER = 0.0108  # width of one character of a phase's name, of the width of a panel


def column(log: RunLog, name: str) -> FloatArray:
    """Return one field of all samples, shape (N,)."""
    return np.array([getattr(sample, name) for sample in log.samples], dtype=np.float64)


def robust_limit(*signals: FloatArray) -> float:
    """Return a bound that holds nearly all finite values: epipoles run off to infinity."""
    finite = [np.abs(signal[np.isfinite(signal)]) for signal in signals]
    bounds = [np.percentile(values, 95) for values in finite if len(values)]
    return float(np.clip(1.25 * max(bounds, default=0.0), 10.0, MAX_EPIPOLE))


def draw_strip(axes: Axes, spans: list[PhaseSpan]) -> None:
    """Draw the phases as a bar over time, with their names where they fit."""
    whole = axes.get_xlim()[1]
    axes.set(ylim=(0.0, 1.0))
    axes.set_axis_off()
    for span in spans:
        colour, name = phase_colour(span.name), phase_label(span.name)
        axes.axvspan(span.start_s, span.end_s, color=colour, linewidth=0.0)
        if (span.end_s - span.start_s) / whole > CHARACTER * (len(name) + 1):
            middle = 0.5 * (span.start_s + span.end_s)
            ink = text_colour_on(colour)
            axes.text(middle, 0.46, name, color=ink, fontsize=8.0, ha='center', va='center')


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
    values = np.array([getattr(sample.twist, name) for sample in log.samples])
    # A command holds until the next one.
    axes.plot(seconds(log), values, color=INK, drawstyle='steps-post')
    axes.axhline(0.0, color=INK, linewidth=0.6)
    low, high = min(values.min(), 0.0), max(values.max(), 0.0)
    if high - low < STANDING:
        low, high = -STANDING_AXIS, STANDING_AXIS
    margin = 0.12 * (high - low)
    axes.set(ylim=(low - margin, high + margin), ylabel=f'{name}\nvelocity [{unit}]')
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _draw_difference(axes: Axes, log: RunLog) -> None:
    values = column(log, 'feature_difference')
    axes.plot(seconds(log), values, color=INK)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_ylabel('D [px$^2$]')
    if _lacks(axes, values):
        return
    # D has a sign and falls by decades; below 1 px^2 the axis is linear.
    axes.set_yscale('symlog', linthresh=1.0)
    low, high = _decades(-values), _decades(values)
    stride = next(it for it in (1, 2, 3, 4, 6, 12) if (low + high) / it <= MOST_STRIDES)
    ticks = {-(10.0**n): f'$-10^{{{n}}}$' for n in range(stride, low + 1, stride)}
    ticks |= {0.0: '0', **{10.0**n: f'$10^{{{n}}}$' for n in range(stride, high + 1, stride)}}
    axes.set_yticks([*ticks], labels=[*ticks.values()])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(-(10.0**low) if low else -0.5, 10.0**high if high else 0.5)


def _decades(values: FloatArray) -> int:
    """Return the power of ten that no value exceeds, 2 at least; 0 if none is above zero."""
    largest = values[np.isfinite(values)].max(initial=0.0)
    return max(2, int(np.ceil(np.log10(largest)))) if largest > 0.0 else 0


def _draw_count(axes: Axes, log: RunLog) -> None:
    axes.plot(seconds(log), column(log, 'features'), color=INK, drawstyle='steps-post')
    axes.set_ylabel('visible\nfeatures')
    axes.set_ylim(bottom=0.0, top=1.15 * max(1.0, column(log, 'features').max()))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def _draw_error(axes: Axes, log: RunLog) -> None:
    axes.plot(seconds(log), column(log, 'feature_error'), color=INK)
    axes.set_ylabel('median feature\nerror [px]')
    _scale_by_decades(axes, column(log, 'feature_error'))


def _draw_distance(axes: Axes, log: RunLog) -> None:
    true = np.array([sample.pose.distance for sample in log.samples])
    ended = np.array([sample.phase.ended for sample in log.samples])  # nothing goes by it
    estimate = np.where(ended, np.nan, column(log, 'distance_estimate'))
    axes.plot(seconds(log), true, color=INK, label='true $d$')
    axes.plot(seconds(log), estimate, '--', color=CURRENT_COLOUR, label=r'estimate $\hat{d}$')
    axes.set_ylabel('distance [m]')
    _scale_by_decades(axes, np.concatenate([true, estimate]))
    _key_above(axes)


def _scale_by_decades(axes: Axes, values: FloatArray) -> None:
    positive = values[np.isfinite(values) & (values > 0.0)]
    if _lacks(axes, positive):
        return
    axes.set_yscale('log')
    low, high = np.floor(np.log10(positive.min())), np.ceil(np.log10(positive.max()))
    axes.set_ylim(10.0**low, 10.0 ** max(high, low + 1.0))
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


PANELS: tuple[Panel, ...] = (
    _draw_epipoles,
    partial(_draw_velocity, name='linear', unit='m/s'),
    partial(_draw_velocity, name='angular', unit='rad/s'),
    _draw_difference,
    _draw_count,
    _draw_error,
    _draw_distance,
)
