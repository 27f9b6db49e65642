"""A figure that the paper does not have: what its printed sign does."""

from collections.abc import Sequence

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.reproduction.canvas import draw_robot, GREY, label, page
from visual_servo_epipolar.evaluation.reproduction.simulations.continuous import Instant
from visual_servo_epipolar.evaluation.reproduction.simulations.runs import PERIOD_S, Simulation1
from visual_servo_epipolar.report.style import CURRENT_COLOUR, DESIRED_COLOUR, FIGURE_SETTINGS, INK

Way = Sequence[Instant]


@rc_context(FIGURE_SETTINGS)
def printed_sign(runs: Simulation1) -> Figure:
    """Draw where the printed and the corrected sign lead: same start, sampled, and behind."""
    figure = page('Not in the paper: sign($e_{au} e_{du}$) as printed, and the true sigma', 4.4)
    for axes, title, printed, corrected in zip(
        figure.subplots(1, 3),
        ('continuous time', f'sampled, {PERIOD_S:g} s', 'from behind the goal'),
        (runs.course.instants, runs.sampled_printed, runs.behind_printed.instants),
        (runs.corrected.instants, runs.sampled_corrected, runs.behind_corrected.instants),
        strict=True,
    ):
        draw_robot(axes, DESIRED_POSE, GREY, dashed=True)
        _draw(axes, corrected, DESIRED_COLOUR, 2.4, 'true sigma')
        _draw(axes, printed, CURRENT_COLOUR, 1.1, 'as printed')
        draw_robot(axes, printed[0].pose, INK)
        label(axes, 'x [m]', 'y [m]', title)
        axes.set_aspect('equal', adjustable='datalim')
    figure.axes[1].legend(loc='upper right')
    return figure


def _draw(axes: Axes, way: Way, colour: str, width: float, name: str) -> None:
    places = np.array([(i.pose.x, i.pose.y) for i in way if i.step == 1])
    axes.plot(*places.T, color=colour, lw=width, label=name)
    axes.plot(*places[-1], 'o', color=colour, ms=3.0 + width)
