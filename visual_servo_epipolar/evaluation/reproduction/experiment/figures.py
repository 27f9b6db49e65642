"""Figures 17 to 20: the experiment."""

import math
from typing import Any

import cv2
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import RunLog, seconds
from visual_servo_epipolar.evaluation.reproduction.canvas import label, numbered
from visual_servo_epipolar.evaluation.reproduction.experiment.experiment import Experiment
from visual_servo_epipolar.evaluation.reproduction.statements import Decay, decay
from visual_servo_epipolar.report.canvas import draw_robot
from visual_servo_epipolar.report.style import (
    CURRENT_COLOUR,
    DESIRED_COLOUR,
    FIGURE_SETTINGS,
    INK,
)
from visual_servo_epipolar.simulation.cameras import CameraSettings

SNAPSHOTS = 6
KEY = 'red crosses: actual features, green circles: desired ones;\ndashed: the goal'
EPIPOLES = '; diamonds: epipoles'
LEAST = 0.03  # of the first D: below, the uneven floor has the say
SMALL = {**FIGURE_SETTINGS, 'axes.labelsize': 7.0, 'xtick.labelsize': 7.0, 'ytick.labelsize': 7.0}
RED, GREEN = '#E00000', '#00A000'


def split(log: RunLog) -> int:
    """Return the number of the first sample of the second step; all, if there is none."""
    phases = [sample.phase for sample in log.samples]
    second = Phase.MATCHING_FEATURES
    return phases.index(second) if second in phases else len(phases)


def signal(log: RunLog, name: str) -> FloatArray:
    """Return a field of all samples, shape (N,)."""
    return np.array([getattr(sample, name) for sample in log.samples], dtype=np.float64)


def difference_decay(log: RunLog) -> Decay:
    """Return the decay of D in the second step, down to 3 % of where it began."""
    first = split(log)
    values = signal(log, 'feature_difference')[first:]
    below = np.flatnonzero(np.abs(values) < LEAST * abs(values[0]))
    end = int(below[0]) if len(below) else len(values)
    time = np.array(seconds(log)[first:])
    return decay((time - time[0])[:end], values[:end])


@rc_context(FIGURE_SETTINGS)
def epipoles(experiment: Experiment) -> Figure:
    """Draw figure 17: both epipoles in the first step."""
    figure = numbered(17, 'experiment, first step: epipoles', 3.2)
    count = split(experiment.log)
    time = np.array(seconds(experiment.log)[:count])
    whole, close = figure.subplots(1, 2)
    for name, colour, words in (
        ('epipole_current', CURRENT_COLOUR, 'actual $e_{au}$'),
        ('epipole_desired', DESIRED_COLOUR, 'desired $e_{du}$'),
    ):
        values = signal(experiment.log, name)[:count]
        for axes in (whole, close):
            axes.plot(time, values, color=colour, label=words)
    edge = experiment.camera.width - experiment.camera.principal_u
    whole.axhline(edge, color=INK, lw=0.7, ls='--')
    label(whole, 'time [s]', 'epipole [px]', 'dashed: right edge of the image')
    close.set_ylim(-60.0, 400.0)
    label(close, 'time [s]', 'epipole [px]', 'close-up')
    whole.legend()
    return figure


@rc_context(FIGURE_SETTINGS)
def difference(experiment: Experiment) -> Figure:
    """Draw figure 18: D in the second step."""
    figure = numbered(18, 'experiment, second step: mean difference D of squared norms', 3.2)
    log, first = experiment.log, split(experiment.log)
    time = np.array(seconds(log)[first:])
    time, values = time - time[0], signal(log, 'feature_difference')[first:]
    linear, logarithmic = figure.subplots(1, 2)
    colour = phase_colour('matching_features')
    linear.plot(time, values, color=colour, label='D')
    logarithmic.plot(time, np.abs(values), color=colour, label='|D|')
    fit = difference_decay(log)
    fitted = time[time <= fit.end]
    for axes in (linear, logarithmic):
        axes.plot(fitted, fit.at(fitted), color=INK, ls='--', lw=0.9, label='exponential')
        axes.legend()
    logarithmic.set_yscale('log')
    label(linear, 'time in the second step [s]', 'D [px$^2$]')
    title = f'fitted rate {fit.rate:.3f} s$^{{-1}}$'
    label(logarithmic, 'time in the second step [s]', '|D| [px$^2$]', title)
    return figure


@rc_context(SMALL)
def snapshots(experiment: Experiment, number: int) -> Figure:
    """Draw figure 19 or 20: six moments of a step, from above and on the desired image."""
    word, key = ('first', KEY + EPIPOLES) if number == 19 else ('second', KEY)
    figure = numbered(number, f'experiment, {word} step: six snapshots\n{key}', 6.0)
    count = split(experiment.log)
    rows = range(count) if number == 19 else range(count, len(experiment.log.samples))
    moments = evenly_moved(experiment.log, rows)
    grid = figure.subplots(3, 4, width_ratios=(1.0, 2.3, 1.0, 2.3))
    for place, moment in enumerate(moments):
        row, column = divmod(place, 2)
        _draw_plane(grid[row][2 * column], experiment.log, moment)
        _draw_image(grid[row][2 * column + 1], experiment, moment, epipoles=number == 19)
    return figure


def evenly_moved(log: RunLog, rows: range) -> list[int]:
    """Return six samples of ``rows`` between which the robot moved alike, first and last too."""
    poses = [log.samples[row].pose for row in rows]
    moved = [0.0]
    for a, b in zip(poses, poses[1:], strict=False):
        turn = abs(math.remainder(b.theta - a.theta, 2.0 * math.pi))
        moved.append(moved[-1] + math.hypot(b.x - a.x, b.y - a.y) + turn)
    parts = np.linspace(0.0, moved[-1], SNAPSHOTS)
    return [rows[min(int(np.searchsorted(moved, part)), len(moved) - 1)] for part in parts]


def _draw_plane(axes: Axes, log: RunLog, moment: int) -> None:
    way = np.array([(sample.pose.x, sample.pose.y) for sample in log.samples])
    sample = log.samples[moment]
    axes.plot(*way[: moment + 1].T, color=DESIRED_COLOUR, lw=1.0, label='way')
    draw_robot(axes, DESIRED_POSE, dashed=True)
    draw_robot(axes, sample.pose, INK)
    low, high = way.min(axis=0) - 0.4, way.max(axis=0) + 0.4
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_aspect('equal')
    label(axes, 'x [m]', 'y [m]', f't = {seconds(log)[moment]:.1f} s')


def _draw_image(axes: Axes, experiment: Experiment, moment: int, *, epipoles: bool) -> None:
    camera, features = experiment.camera, experiment.features[moment]
    small = cv2.resize(experiment.desired, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    extent = (0.0, camera.width, camera.height, 0.0)
    axes.imshow(small, cmap='gray', vmin=-80, vmax=255, extent=extent, interpolation='bilinear')
    axes.grid(False)
    green: dict[str, Any] = {'mfc': 'none', 'mec': GREEN, 'ms': 4.5, 'mew': 0.9, 'ls': ''}
    axes.plot(*features.desired.T, 'o', label='desired', **green)
    axes.plot(*features.current.T, 'x', color=RED, ms=4.0, mew=0.9, label='actual')
    if epipoles:
        sample = experiment.log.samples[moment]
        for value, colour, name in (
            (sample.epipole_current, CURRENT_COLOUR, '$e_{au}$'),
            (sample.epipole_desired, DESIRED_COLOUR, '$e_{du}$'),
        ):
            _draw_epipole(axes, camera.principal_u + value, camera, colour, name)
    axes.set(xlim=(0, camera.width), ylim=(camera.height, 0))
    label(axes, 'u [px]', 'v [px]')


def _draw_epipole(axes: Axes, u: float, camera: CameraSettings, colour: str, name: str) -> None:
    """Mark an epipole, or the edge beyond which it lies."""
    if math.isnan(u):
        return
    width, row = camera.width, camera.principal_v
    inside = 0.0 <= u <= width
    mark = 'D' if inside else ('>' if u > width else '<')
    at = min(max(u, 0.0), width)
    axes.plot([at], [row], mark, color=colour, mec='white', ms=6.0, label=name, clip_on=False)
