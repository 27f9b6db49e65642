"""Draws figures of docs/extensions.md: python docs/car_figures.py."""

from itertools import pairwise
import math
from pathlib import Path
from typing import Any

from iterated import (
    AttemptError,
    bound,
    errors,
    PLANTS,
)
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, saturate
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks.laws import POSE_LAWS
from visual_servo_epipolar.report.style import FIGURE_SETTINGS

ATTEMPTS = 5
FIRST = AttemptError(0.1, -0.1)
COLOURS = ('#8C8C8C', '#D55E00', '#E69F00', '#56B4E9', '#CC79A7', '#0072B2', '#009E73')
STARTS = ((0.8, -1.0, 0.0), (-1.2, -2.2, 10.0))
LAWS = {'graceful': '#8C8C8C', 'displaced': '#0072B2'}
DT, SECONDS = 0.02, 40.0


def iterated() -> Figure:
    """Return sizes of errors by attempt, and by how much one attempt contracts, with its bound."""
    canvas = _canvas()
    course, factors = canvas.subplots(1, 2, width_ratios=(1.2, 1.0))
    for row, ((name, plant), colour) in enumerate(zip(PLANTS.items(), COLOURS, strict=True)):
        sizes = np.array([error.size for error in errors(plant, FIRST, ATTEMPTS)])
        course.semilogy(1e3 * sizes**2, marker='o', color=colour, label=name)
        factors.plot(sizes[1] / sizes[0], row, 'o', color=colour)
        factors.plot(bound(sizes[0], plant) / sizes[0], row, '|', color=colour, markersize=14)
    course.set(xlabel='attempt', ylabel='squared size of the error [mm], as if aside')
    course.axhline(1.0, color='#DDDDDD', linewidth=1.0)
    factors.set(xlabel='contraction factor of attempt 1, and its bound (|)', xlim=(-0.05, 1.05))
    factors.set_yticks(range(len(PLANTS)), list(PLANTS))
    factors.invert_yaxis()
    return canvas


def displaced() -> Figure:
    """Return ways of a point off the axle and of one on it, and the headings that are left."""
    canvas = _canvas()
    plan, headings = canvas.subplots(1, 2)
    for name, colour in LAWS.items():
        for start in STARTS:
            poses = _driven(name, start)
            plan.plot([it.x for it in poses], [it.y for it in poses], color=colour)
            left = [math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(poses)]
            turned = [abs(math.degrees(it.heading_error)) + 1e-3 for it in poses[1:]]
            way = np.cumsum(left)
            headings.semilogy(way[-1] - way, turned, color=colour, label=name)
    plan.set(xlabel='right of the goal [m]', ylabel='ahead [m]', aspect='equal')
    headings.set(xlabel='way left [m]', ylabel='heading error [deg]', xlim=(1.5, 0.0))
    headings.legend(*zip(*_once(headings), strict=True))
    return canvas


def _driven(name: str, start: tuple[float, float, float]) -> list[Pose]:
    settings, poses = ServoSettings(), [Pose.from_start(*start)]
    for _ in range(round(SECONDS / DT)):
        twist = saturate(
            POSE_LAWS[name](poses[-1], settings),
            max_linear=settings.max_linear,
            max_angular=settings.max_angular,
        )
        poses.append(integrate(poses[-1], twist, DT))
    return poses


def _once(axes: Axes) -> list[tuple[Any, str]]:
    handles, labels = axes.get_legend_handles_labels()
    return list(
        {label: (handle, label) for handle, label in zip(handles, labels, strict=True)}.values()
    )


def _canvas() -> Figure:
    canvas = Figure(figsize=(9.0, 3.4), layout='constrained')
    FigureCanvasAgg(canvas)
    return canvas


if __name__ == '__main__':
    for name, draw in {'iterated': iterated, 'displaced': displaced}.items():
        with rc_context(FIGURE_SETTINGS):
            draw().savefig(Path(__file__).with_name(f'extensions_{name}.png'), dpi=110)
