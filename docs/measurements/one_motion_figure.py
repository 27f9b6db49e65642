"""
Draws docs/measurements/one_motion.png: laws `full` and `smooth` from the same twelve starts.

`python docs/measurements/one_motion_figure.py [TARGET.png]`: trajectories beside each other, and
both velocities over time of two of them; point features, nominal, seed 21.
"""

from collections.abc import Sequence
from pathlib import Path
import sys

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.core.servo.run_log import least_time, RunLog, seconds
from visual_servo_epipolar.report.style import FIGURE_SETTINGS, INK
from visual_servo_epipolar.simulation import views
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import Scenario

LAWS = ('full', 'smooth')
STARTS = (*(('front', index) for index in range(9)), *(('beside', index) for index in (0, 3, 8)))
SHOWN = (8, 10)  # of the starts, whose velocities are drawn
SEED = 21
TARGET = Path(__file__).with_name('one_motion.png')


def drive(law: str) -> list[RunLog]:
    """Return the runs of a law from all starts."""
    runs = []
    for region, index in STARTS:
        seed = 1000 * SEED + index
        scenario = Scenario().with_servo({'law': law}).seeded(seed)
        runs.append(views.drive(scenario, start_in(region, SEED, index, scenario), seed))
    return runs


def draw(logs: dict[str, Sequence[RunLog]]) -> Figure:
    """Draw the trajectories of each law in a row of their own, and the velocities beside."""
    figure = Figure(figsize=(9.6, 8.4), layout='constrained')
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(4, 2, width_ratios=(1.0, 1.5))
    for row, (law, runs) in enumerate(logs.items()):
        _map(figure.add_subplot(grid[2 * row : 2 * row + 2, 0]), law, runs)
        on_the_way = (s for log in runs for s in log.samples if s.phase.drives)
        words = dict.fromkeys(sample.phase.value for sample in on_the_way)
        phases = [Line2D([], [], color=phase_colour(word), label=word) for word in words]
        figure.axes[-1].legend(handles=phases, loc='upper left', bbox_to_anchor=(1.02, 1.0))
        for place, index in enumerate(SHOWN):
            _velocities(figure.add_subplot(grid[2 * row + place, 1]), law, runs[index])
    return figure


def _map(axes: Axes, law: str, runs: Sequence[RunLog]) -> None:
    for log in runs:
        for before, after in zip(log.samples, log.samples[1:], strict=False):
            xs, ys = (before.pose.x, after.pose.x), (before.pose.y, after.pose.y)
            axes.plot(xs, ys, color=phase_colour(before.phase.value), lw=1.2)
        axes.plot(log.start[0], log.start[1], 'o', ms=3, color=INK)
    axes.set(xlabel='x [m]', ylabel='y [m]', title=f'law {law}', aspect='equal')


def _velocities(axes: Axes, law: str, log: RunLog) -> None:
    times = seconds(log)
    axes.plot(times, [sample.twist.linear for sample in log.samples], label='linear [m/s]')
    axes.plot(times, [sample.twist.angular for sample in log.samples], label='angular [rad/s]')
    if log.limits is not None:
        least = least_time(Pose.from_start(*log.start), log.limits)
        axes.axvline(least, color=INK, ls=':', lw=1.0, label='least time')
    x, y, heading = log.start
    axes.set(xlabel='time [s]', ylabel='velocity', xlim=(0.0, 25.0))
    axes.set_title(f'{law} from {x:.2f} m, {y:.2f} m, {heading:.0f} deg')
    axes.legend(loc='upper right')


def main() -> None:
    """Drive and draw."""
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET
    with rc_context(FIGURE_SETTINGS):
        draw({law: drive(law) for law in LAWS}).savefig(target, dpi=110)


if __name__ == '__main__':
    main()
