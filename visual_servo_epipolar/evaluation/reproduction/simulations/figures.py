"""Figures 7 to 15: the two simulations."""

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.registry import phase_colour
from visual_servo_epipolar.evaluation.reproduction.canvas import label, numbered
from visual_servo_epipolar.evaluation.reproduction.simulations.continuous import (
    Course,
    PointCamera,
)
from visual_servo_epipolar.evaluation.reproduction.statements import decay
from visual_servo_epipolar.report.canvas import draw_robot
from visual_servo_epipolar.report.style import (
    CURRENT_COLOUR,
    DESIRED_COLOUR,
    FIGURE_SETTINGS,
    INK,
)

FIRST, SECOND = phase_colour('zeroing_epipoles'), phase_colour('matching_features')
TRANSIENT = 1.3  # of the time at which e_du is zero: what the close-ups show
SHOWN_S = 12.0  # of the first step on a linear scale: later everything is zero to the eye
MILLI = 1000.0


@rc_context(FIGURE_SETTINGS)
def epipoles(course: Course, number: int) -> Figure:
    """Draw figure 7 or 14: both epipoles in the first step."""
    figure = numbered(number, f'{course.case.name}, first step: epipoles', 3.0)
    whole, close, logarithmic = figure.subplots(1, 3)
    time = course.column('time', 1)
    lines = (
        (course.column('reading.e_current', 1), CURRENT_COLOUR, 'actual $e_{au}$'),
        (course.column('reading.e_desired', 1), DESIRED_COLOUR, 'desired $e_{du}$'),
    )
    for values, colour, name in lines:
        whole.plot(time, MILLI * values, color=colour, label=name)
        close.plot(time, MILLI * values, color=colour, label=name)
        logarithmic.plot(time, np.abs(values), color=colour, label=name)
    for axes in (whole, close):
        label(axes, 'time [s]', 'epipole [mm]')
        axes.axvline(course.zeroed_at, color=INK, lw=0.7, ls=':')
    whole.set_xlim(0.0, SHOWN_S)
    close.set_xlim(0.0, TRANSIENT * course.zeroed_at)
    close.set_title(f'$e_{{du}} = 0$ at {course.zeroed_at:.3f} s', fontsize=9.0)
    whole.legend()
    logarithmic.axhline(course.case.tolerance, color=INK, lw=0.7, ls='--')
    logarithmic.set(yscale='log', ylim=(1e-10, 0.3))
    label(logarithmic, 'time [s]', '|epipole| [m]', 'dashed: tolerance')
    return figure


@rc_context(FIGURE_SETTINGS)
def velocities(course: Course, number: int) -> Figure:
    """Draw figure 8: linear and angular velocity in the first step."""
    figure = numbered(number, f'{course.case.name}, first step: velocities of the robot', 5.0)
    time = course.column('time', 1)
    grid = figure.subplots(2, 2)
    for row, end in zip(grid, (TRANSIENT * course.zeroed_at, SHOWN_S), strict=True):
        for axes, values, name in zip(
            row,
            (course.column('twist.linear', 1), course.column('twist.angular', 1)),
            ('linear $u_1$ [m/s]', 'angular $u_2$ [rad/s]'),
            strict=True,
        ):
            axes.plot(time, values, color=FIRST, label=name)
            axes.axvline(course.zeroed_at, color=INK, lw=0.7, ls=':')
            axes.set_xlim(0.0, end)
            label(axes, 'time [s]', name)
    title = f'$u_1 = 0$ with $e_{{du}}$, from {course.zeroed_at:.3f} s on'
    grid[0][0].set_title(title, fontsize=9.0)
    return figure


@rc_context(FIGURE_SETTINGS)
def path(course: Course, number: int, step: int) -> Figure:
    """Draw figure 9, 12 or 15: the trajectory of one step in the plane."""
    word = 'first' if step == 1 else 'second'
    figure = numbered(number, f'{course.case.name}, {word} step: trajectory', 4.6, width=4.4)
    axes = figure.subplots()
    colour = FIRST if step == 1 else SECOND
    instants = [instant for instant in course.instants if instant.step == step]
    x, y = course.column('pose.x', step), course.column('pose.y', step)
    axes.plot(x, y, color=colour, lw=2.0, label=f'{word} step')
    axes.plot(0.0, 0.0, '+', color=INK, markersize=10.0)
    draw_robot(axes, DESIRED_POSE, dashed=True)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    for part in np.linspace(0.0, way[-1], 5):
        draw_robot(axes, instants[int(np.searchsorted(way, part))].pose, colour)
    if step == 1:  # the rotation at the end of the path
        draw_robot(axes, instants[-1].pose, INK)
    label(axes, 'x [m]', 'y [m]', 'dashed: desired configuration')
    axes.set_aspect('equal', adjustable='datalim')
    return figure


@rc_context(FIGURE_SETTINGS)
def distance(course: Course, number: int) -> Figure:
    """Draw figure 10: the distance to the goal in the second step."""
    figure = numbered(number, f'{course.case.name}, second step: distance d to the goal', 3.0)
    time, values = second_step(course, 'pose.distance')
    linear, logarithmic = figure.subplots(1, 2)
    fit = decay(time[len(time) // 2 :], values[len(time) // 2 :])
    for axes in (linear, logarithmic):
        axes.plot(time, values, color=SECOND, label='d')
        label(axes, 'time in the second step [s]', 'd [m]')
    logarithmic.plot(time, fit.at(time), color=INK, ls='--', lw=0.8, label='exponential')
    logarithmic.set_yscale('log')
    logarithmic.set_title(f'fitted rate {fit.rate:.5f} s$^{{-1}}$ (second half)', fontsize=9.0)
    logarithmic.legend()
    return figure


@rc_context(FIGURE_SETTINGS)
def linear_velocity(course: Course, number: int) -> Figure:
    """Draw figure 11: the linear velocity in the second step."""
    figure = numbered(number, f'{course.case.name}, second step: linear velocity', 3.0)
    time, values = second_step(course, 'twist.linear')
    linear, logarithmic = figure.subplots(1, 2)
    linear.plot(time, values, color=SECOND, label='$u_1$')
    label(linear, 'time in the second step [s]', 'linear $u_1$ [m/s]')
    logarithmic.plot(time, np.abs(values), color=SECOND, label='$|u_1|$')
    logarithmic.set_yscale('log')
    label(logarithmic, 'time in the second step [s]', '$|u_1|$ [m/s]')
    return figure


@rc_context(FIGURE_SETTINGS)
def feature_motion(course: Course, number: int) -> Figure:
    """Draw figure 13: the features in the image plane, from + to *, and how far they are."""
    figure = numbered(number, f'{course.case.name}: motion of the features', 4.4)
    plane, gap = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    camera = PointCamera(course.case.focal, course.case.focal_guess)
    images = np.stack([camera.image(instant.pose) for instant in course.instants])
    steps = course.column('time'), np.array([instant.step for instant in course.instants])
    _draw_tracks(plane, MILLI * images, steps[1])
    plane.plot(*(MILLI * camera.desired).T, '*', color=DESIRED_COLOUR, ms=9.0, label='desired (*)')
    plane.legend(loc='lower center', bbox_to_anchor=(0.5, 1.0), ncols=2)
    label(plane, 'u [mm]', 'v [mm]')
    plane.invert_yaxis()
    plane.set_aspect('equal', adjustable='datalim')
    apart = MILLI * np.linalg.norm(images - camera.desired, axis=2).mean(axis=1)
    for step, colour, name in ((1, FIRST, 'first step'), (2, SECOND, 'second step')):
        rows = steps[1] == step
        gap.plot(steps[0][rows] + 0.1, apart[rows], color=colour, label=name)
    gap.set_xscale('log')
    gap.legend()
    label(gap, 'time + 0.1 s [s]', 'mean distance to the desired features [mm]')
    return figure


def _draw_tracks(axes: Axes, images: FloatArray, steps: FloatArray) -> None:
    for feature in range(images.shape[1]):
        for step, colour in ((1, FIRST), (2, SECOND)):
            rows = steps == step
            name = f'feature {feature + 1}, step {step}'
            axes.plot(*images[rows, feature].T, color=colour, lw=1.0).pop().set_gid(name)
    axes.plot(*images[0].T, '+', color=CURRENT_COLOUR, ms=9.0, mew=1.5, label='initial (+)')


def second_step(course: Course, name: str) -> tuple[FloatArray, FloatArray]:
    """Return time from the beginning of the second step [s], and one quantity, shape (N,) each."""
    time = course.column('time', 2)
    return time - time[0], course.column(name, 2)
